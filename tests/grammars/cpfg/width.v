line style: cylinder
initial line width: 0.2
line width increment: 0.1
tapered lines: off
