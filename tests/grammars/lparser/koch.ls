# One side of the snowflake in three steps.
3
60
5
F
F=F+F--F+F
@
anything after the mark is left out
