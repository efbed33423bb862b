# Half of the last step.
1.5
90
10
FA
A=FA
@
