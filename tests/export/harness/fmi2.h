typedef char byte;
#define GET_STATE fmi2GetFMUstate
#define SET_STATE fmi2SetFMUstate
#define FREE_STATE fmi2FreeFMUstate
#define STATE_SIZE fmi2SerializedFMUstateSize
#define TO_BYTES fmi2SerializeFMUstate
#define FROM_BYTES fmi2DeSerializeFMUstate
#define FREE fmi2FreeInstance
void *fmi2Instantiate(const char *, int, const char *, const char *, const void *, int, int);
int fmi2SetupExperiment(void *, int, double, double, int, double);
int fmi2EnterInitializationMode(void *);
int fmi2ExitInitializationMode(void *);
int fmi2SetReal(void *, const unsigned *, size_t, const double *);
int fmi2GetReal(void *, const unsigned *, size_t, double *);
int fmi2DoStep(void *, double, double, int);
int fmi2GetRealStatus(void *, int, double *);
int fmi2GetDirectionalDerivative(
    void *, const unsigned *, size_t, const unsigned *, size_t, const double *, double *);

static void *made(const char *token) { return fmi2Instantiate("hurt", 1, token, NULL, NULL, 0, 0); }
static void begun(void *own)
{
    fmi2SetupExperiment(own, 0, 0.0, 0.0, 0, 0.0);
    fmi2EnterInitializationMode(own);
    fmi2ExitInitializationMode(own);
}
static int set(void *own, unsigned which, const double *value) { return fmi2SetReal(own, &which, 1, value); }
static int get(void *own, unsigned which, double *value) { return fmi2GetReal(own, &which, 1, value); }
static int stepped(void *own, double *time, double length)
{
    fmi2GetRealStatus(own, 2, time);
    return fmi2DoStep(own, *time, length, 1);
}
static int sloped(void *own, unsigned output, const unsigned *known, const double *by, double *slope)
{
    return fmi2GetDirectionalDerivative(own, &output, 1, known, 2, by, slope);
}

int GET_STATE(void *, void **);
int SET_STATE(void *, void *);
int FREE_STATE(void *, void **);
int STATE_SIZE(void *, void *, size_t *);
int TO_BYTES(void *, void *, byte *, size_t);
int FROM_BYTES(void *, const byte *, size_t, void **);
void FREE(void *);
