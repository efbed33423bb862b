# Letters without a meaning become '_'.
2
45
10
AqFq
A=qA
@
