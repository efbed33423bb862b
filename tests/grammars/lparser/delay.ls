# Digits are symbols that rules count down.
4
45
10
F3
3=2
2=1
1=FF
@
