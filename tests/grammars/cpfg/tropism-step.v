line style: cylinder
tropism: T: 0,1,0 E: 0 S: 0.05
