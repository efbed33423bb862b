line style: cylinder
function: growth.func
