#include <stdio.h>
static SimStruct S;
int main(void)
{
    static double period = 0.01, start[64];
    int k, j;
    start[0] = 10.0;
    S.parameters[0] = (mxArray){1, &period};
    S.parameters[1] = (mxArray){0, start};
    mdlInitializeSizes(&S);
    S.parameters[1].count = STARTS ? (size_t)S.states : 0;
    mdlInitializeSampleTimes(&S);
    if (S.work * (int)sizeof(double) > (int)sizeof S.held || S.period != 0.01) return 1;
    mdlInitializeConditions(&S);
    for (k = 0; k < 40; k++) {
        S.time = k * 0.01;
        S.u[0] = k < 5 ? 0.0 : 0.05;
        S.u[1] = 1.0;
        mdlOutputs(&S, 0);
        for (j = 0; j < S.outputs; j++) printf("%.17g ", S.y[j]);
        printf("\n");
        mdlUpdate(&S, 0);
        if (S.error) return 2;
    }
    mdlTerminate(&S);
    return 0;
}
