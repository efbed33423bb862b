# Settings of the viewer are no part of the axiom, whose first words they would be.
recursion 2
angle 90
switch_yz 1
no_wait 1
axiom a+F
rule a = Fa
@ of the file
F=G
the rest is text
