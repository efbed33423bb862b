# Rolls to both sides cancel.
1
50
10
<&>F%%F
@
