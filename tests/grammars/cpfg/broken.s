0 1 0 2 0 0
CONTACT POINT X: 0.5 Y: 0 Z: 0
nonsense
