# A polygon of four corners on a stalk.
1
60
10
F{.+f-f-(120)f-f}
@
