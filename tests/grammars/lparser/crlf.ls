# Lines of DOS.
2
90
10
A
A=F+A
@
