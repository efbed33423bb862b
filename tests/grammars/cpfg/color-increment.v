line style: cylinder
initial color: 10
color increment: 5
