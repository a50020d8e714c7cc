/* @TITLE@
   What is done on a straight, and how long a call takes. */

#include "@.h"

#include <stdio.h>
#include <time.h>

int main(void)
{
    double seen[@SIZE@] = {@SPEED@}, action[@ACTIONS@], sum = 0.0;
    const int calls = 200000;
    clock_t begun;
    int k;
    @_act(seen, action);
    printf("steering %.6f, drive %.6f\n", action[0], action[1]);
    begun = clock();
    for (k = 0; k < calls; k++) {
        seen[0] = 1e-6 * k;
        @_act(seen, action);
        sum += action[0];
    }
    printf("%.2f microseconds a call (sum %.3f)\n", 1e6 * (double)(clock() - begun) / CLOCKS_PER_SEC / calls, sum);
    return 0;
}
