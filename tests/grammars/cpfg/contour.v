line style: cylinder
contour: 1 ribbon.con
