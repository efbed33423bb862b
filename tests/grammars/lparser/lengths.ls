# Lengths are percent of a step in this form.
1
90
10
F(250)Ff(50)F
@
