line style: cylinder
surface: l jump.s 0.5
