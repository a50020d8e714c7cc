/* @TITLE@
   Compares actions with what Python computed in single precision. */

#include "@.h"

#include <math.h>
#include <stdio.h>

@SEEN@
@EXPECTED@
int main(void)
{
    double worst = 0.0, action[@ACTIONS@];
    int i, k;
    for (k = 0; k < @POINTS@; k++) {
        @_act(given_seen[k], action);
        for (i = 0; i < @ACTIONS@; i++) {
            const double off = fabs(action[i] - expected[k][i]);
            if (worst == worst && !(off <= worst)) { /* what is no number stays the worst */
                worst = off;
            }
        }
    }
    printf("@: @POINTS@ observations, largest difference %.1e\n", worst);
    return worst <= @TOLERANCE@ ? 0 : 1;
}
