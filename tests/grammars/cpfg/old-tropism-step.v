line style: cylinder
elasticity increment: 0.2
