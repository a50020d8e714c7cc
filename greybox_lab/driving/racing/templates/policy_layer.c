static void layer_@LAYER@(const double *restrict x, double *restrict y)
{
    double z[@RESULTS@];
    int i, j;
    for (j = 0; j < @RESULTS@; j++) {
        z[j] = biases_@LAYER@[j];
    }
    for (i = 0; i < @GIVEN@; i++) {
        const double given = x[i];
        for (j = 0; j < @RESULTS@; j++) {
            z[j] += given * weights_@LAYER@[i][j];
        }
    }
    for (j = 0; j < @RESULTS@; j++) {
        y[j] = @BOUNDED@;
    }
}
