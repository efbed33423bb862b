line style: cylinder
contour sides: 6
