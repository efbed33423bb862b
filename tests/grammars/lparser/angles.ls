# Angles 50, 45 and 90.
1
50
10
+F-:+F-:(2)+F
@
