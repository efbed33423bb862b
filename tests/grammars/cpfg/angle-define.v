#define QUARTER 90 /* degrees */
#ifdef QUARTER
angle increment: QUARTER // of a circle
#else
angle increment: 7
#endif
line style: cylinder
