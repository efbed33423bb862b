line style: cylinder
surface: l broken.s 1
