line style: cylinder
angle factor: 4
