# Rolled, then levelled.
1
45
10
&(60)<(77)$+(90)F
@
