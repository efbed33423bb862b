/* How the poppy is drawn. */
angle increment: 30
line style: cylinder
initial line width: 0.16
initial color: 2
color increment: 1
contour sides: 20
tropism: T: 0 1 0 A: 0 I: 1 E: 0.012 S: 0.004
surface: p petal.s 1 12 12 0
surface: l leaf.s 1 14 10 0
surface: a anther.s 1 6 6 0
function: size.func
contour: 1 bud.con
