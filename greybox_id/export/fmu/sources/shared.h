/* What FMI 2.0 and 3.0 ask alike; read by either once it has said what a component and a status are. */

EXPORTED status FMI(ExitInitializationMode)(void *c)
{
    if (c == NULL || ((component *)c)->own.stage != STARTING) {
        return ERROR;
    }
    MODEL(instance_run)(&((component *)c)->own);
    return OK;
}

EXPORTED status FMI(Terminate)(void *c)
{
    if (c == NULL) {
        return ERROR;
    }
    ((component *)c)->own.stage = OVER;
    return OK;
}

EXPORTED status FMI(Reset)(void *c)
{
    if (c == NULL) {
        return ERROR;
    }
    MODEL(instance_reset)(&((component *)c)->own);
    return OK;
}

/* Copies of a vehicle */

static status copied(const component *c, const void *from, void **state)
{
    if (*state == NULL) {
        *state = taken(c, sizeof(instance));
    }
    if (*state == NULL) {
        return ERROR;
    }
    memcpy(*state, from, sizeof(instance));
    return OK;
}

EXPORTED status OF_STATE(Get, )(void *c, void **state)
{
    return c != NULL && state != NULL ? copied(c, &((component *)c)->own, state) : ERROR;
}

EXPORTED status OF_STATE(Set, )(void *c, void *state)
{
    if (c == NULL || state == NULL) {
        return ERROR;
    }
    memcpy(&((component *)c)->own, state, sizeof(instance));
    return OK;
}

EXPORTED status OF_STATE(Free, )(void *c, void **state)
{
    if (c == NULL || state == NULL) {
        return ERROR;
    }
    if (*state != NULL) {
        given_back(c, *state);
        *state = NULL;
    }
    return OK;
}

EXPORTED status OF_STATE(Serialized, Size)(void *c, void *state, size_t *size)
{
    (void)state;
    *size = sizeof(instance);
    return c != NULL ? OK : ERROR;
}

EXPORTED status OF_STATE(Serialize, )(void *c, void *state, byte bytes[], size_t size)
{
    if (c == NULL || state == NULL || size < sizeof(instance)) {
        return ERROR;
    }
    memcpy(bytes, state, sizeof(instance));
    return OK;
}

EXPORTED status DESERIALIZE(void *c, const byte bytes[], size_t size, void **state)
{
    return c != NULL && state != NULL && size == sizeof(instance) ? copied(c, bytes, state) : ERROR;
}

/* Model exchange */

EXPORTED status FMI(EnterEventMode)(void *c)
{
    return c != NULL ? OK : ERROR;
}

EXPORTED status FMI(EnterContinuousTimeMode)(void *c)
{
    return c != NULL ? OK : ERROR;
}

EXPORTED status FMI(SetTime)(void *c, double time)
{
    if (c == NULL) {
        return ERROR;
    }
    ((component *)c)->own.time = time;
    return OK;
}

EXPORTED status FMI(SetContinuousStates)(void *c, const double x[], size_t count)
{
    if (c == NULL || count != NX) {
        return ERROR;
    }
    memcpy(((component *)c)->own.x, x, NX * sizeof *x);
    return OK;
}

EXPORTED status FMI(GetContinuousStates)(void *c, double x[], size_t count)
{
    if (c == NULL || count != NX) {
        return ERROR;
    }
    memcpy(x, ((component *)c)->own.x, NX * sizeof *x);
    return OK;
}

EXPORTED status RATES(void *c, double rates[], size_t count)
{
    if (c == NULL || count != NX || !CONTINUOUS) {
        return ERROR;
    }
    MODEL(ode)(((component *)c)->own.x, ((component *)c)->own.u, ((component *)c)->own.p, rates);
    return OK;
}

EXPORTED status FMI(GetEventIndicators)(void *c, double values[], size_t count)
{
    (void)values;
    return c != NULL && count == 0 ? OK : ERROR;
}

EXPORTED status FMI(GetNominalsOfContinuousStates)(void *c, double nominals[], size_t count)
{
    size_t k;
    for (k = 0; k < count; k++) {
        nominals[k] = 1.0;
    }
    return c != NULL && count == NX ? OK : ERROR;
}
