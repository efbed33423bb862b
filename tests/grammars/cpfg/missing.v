line style: cylinder
surface: l nowhere.s 1
function: nowhere.func
