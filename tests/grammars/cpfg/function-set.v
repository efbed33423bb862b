line style: cylinder
function set: both.fset
