line style: cylinder
tsurface: t tooth.ray 1
