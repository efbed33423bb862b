line style: cylinder
surface: l blade.s 0.5
surface: y yellow.s 1
