initial line width: 2 p
