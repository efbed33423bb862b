line style: cylinder
contour: 4 path.con
