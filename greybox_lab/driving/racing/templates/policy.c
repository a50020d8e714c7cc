/* @TITLE@ */

#include "@.h"

#include <math.h>

@INLINE@
@TANH@
static const float scales[@SIZE@] = {
@SCALES@
};

@TABLES@
@FUNCTIONS@
void @_act(const double *seen, double *action)
{
    double scaled[@SIZE@];
@BETWEEN@    int i;
    for (i = 0; i < @SIZE@; i++) {
        scaled[i] = scales[i] * seen[i];
    }
@HEADING@    for (i = 0; i < @SIZE@; i++) {
        scaled[i] = scaled[i] < -@LARGEST@ ? -@LARGEST@ : scaled[i] > @LARGEST@ ? @LARGEST@ : scaled[i];
    }
@CALLS@}
