line style: cylinder
surface: l blade.s 0.5 3 2 0
