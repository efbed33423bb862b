line style: cylinder
tropism: T: 0.0 1.0 0.0 A: 0 I: 1 E: 0.1 S: 0
