line style: cylinder
initial color: 255
