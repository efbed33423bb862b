line style: cylinder
initial scale: 2
scale multiplier: 0.5
