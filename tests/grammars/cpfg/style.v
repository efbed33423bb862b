angle factor: 12
initial line width: 0.2
