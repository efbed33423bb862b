line style: cylinder
surface: l blade.s 0.5
