
static double inner(const double *a, const double *b)
{
    double even = 0.0, odd = 0.0, third = 0.0, last = 0.0;
    int k;
    for (k = 0; k + 3 < $_MEMORY; k += 4) {
        even += a[k] * b[k];
        odd += a[k + 1] * b[k + 1];
        third += a[k + 2] * b[k + 2];
        last += a[k + 3] * b[k + 3];
    }
    for (; k < $_MEMORY; k++) {
        even += a[k] * b[k];
    }
    return (even + odd) + (third + last);
}

static void windows(const @_window *window, double *h)
{
    int t;
    for (t = 0; t < $_TAPS; t++) {
        h[t] = inner(window->weights[t], window->z[tap_signal[t]]);
    }
}

/* the newest sample of the window is what the equations see */
static void look(@_window *window, const double *sees)
{
    double z[$_SIGNALS];
    int s;
    memmove(window->u[0], window->u[1], sizeof window->u - sizeof window->u[0]);
    memcpy(window->u[$_MEMORY - 1], sees, sizeof window->u[0]);
    stage(sees, window->p, z);
    for (s = 0; s < $_SIGNALS; s++) {
        memmove(window->z[s], window->z[s] + 1, sizeof window->z[s] - sizeof window->z[s][0]);
        window->z[s][$_MEMORY - 1] = z[s];
    }
}

static void predicted(@_window *window, const double *y)
{
    memmove(window->y[$_PAST > 1 ? 1 : 0], window->y[0], sizeof window->y - sizeof window->y[0]);
    memcpy(window->y[0], y, sizeof window->y[0]);
}

static void advance(@_window *window, const double *u)
{
    double sees[$_SEEN], actuators[$_ACTUATORS];
    memcpy(actuators, window->actuators, sizeof actuators);
    seen(window->y[0], window->actuators, u, window->p, sees, actuators);
    memcpy(window->actuators, actuators, sizeof actuators);
    look(window, sees);
}

void @_start(@_window *window, const double *p, const double *u, const double *y)
{
    int k;
    memset(window, 0, sizeof *window);
    memcpy(window->p, p, $_NP * sizeof(double));
    weights(window->p, window->weights[0]);
    for (k = 0; k < $_PAST; k++) {
        predicted(window, y);
    }
    for (k = 0; k < $_ACTUATORS; k++) {
        window->actuators[k] = actuator_input[k] < 0 ? 0.0 : u[actuator_input[k]];
    }
    for (k = 0; k < $_MEMORY; k++) {
        advance(window, u);
    }
}

void @_push(@_window *window, const double *u, const double *y)
{
    advance(window, u);
    predicted(window, y);
}

void @_step(@_window *window, const double *u)
{
    double h[$_TAPS], y[$_NY];
    advance(window, u);
    windows(window, h);
    head(h, window->u[$_MEMORY - 1], window->p, y);
    predicted(window, y);
}

void @_output(const @_window *window, double *y)
{
    double weight[$_SENSED];
    int i, k, place = 0;
    sensors(window->p, weight);
    for (i = 0; i < $_NY; i++) {
        y[i] = 0.0;
        for (k = 0; k < held[i]; k++) {
            y[i] += weight[place++] * window->y[k][i];
        }
    }
}

void @_step_jacobian(const @_window *window, const double *u, double *y_next, double *by_window, double *by_u,
    double *by_y, double *by_p)
{
    @_window next = *window;
    const double *const now = next.u[$_MEMORY - 1];
    double h[$_TAPS], by_h[$_NY * $_TAPS], by_now[$_NY * $_SEEN], through[$_NY * $_SIGNALS];
    double of_stage[STAGE_BY_U + STAGE_BY_P + 1], of_weights[WEIGHTS_BY_P + 1];
    double sees_by_y[$_SEEN * $_NY], sees_by_u[$_SEEN * $_NU];
    double *newest = by_window + $_NY * $_SEEN * ($_MEMORY - 1);
    int i, j, k, l, r, t;
    advance(&next, u);
    windows(&next, h);
    head(h, now, next.p, y_next);
    head_by(h, now, next.p, by_h, by_now, by_p);
    memset(by_window, 0, sizeof(double) * $_NY * $_SEEN * $_MEMORY);
    for (l = 0; l < $_MEMORY; l++) {
        double *const by_then = by_window + $_NY * $_SEEN * l;
        memset(through, 0, sizeof through); /* of the predictions by the signals at this sample */
        for (t = 0; t < $_TAPS; t++) {
            for (r = 0; r < $_NY; r++) {
                through[r + $_NY * tap_signal[t]] += by_h[r + $_NY * t] * next.weights[t][l];
            }
        }
        stage_by_u(next.u[l], next.p, of_stage);
        for (k = 0; k < STAGE_BY_U; k++) {
            for (r = 0; r < $_NY; r++) {
                by_then[r + $_NY * stage_by_u_column[k]] += through[r + $_NY * stage_by_u_row[k]] * of_stage[k];
            }
        }
        stage_by_p(next.u[l], next.p, of_stage);
        for (k = 0; k < STAGE_BY_P; k++) {
            for (r = 0; r < $_NY; r++) {
                by_p[r + $_NY * stage_by_p_column[k]] += through[r + $_NY * stage_by_p_row[k]] * of_stage[k];
            }
        }
    }
    weights_by_p(next.p, of_weights);
    for (k = 0; k < WEIGHTS_BY_P; k++) {
        t = weights_by_p_row[k] / $_MEMORY;
        l = weights_by_p_row[k] % $_MEMORY;
        for (r = 0; r < $_NY; r++) {
            by_p[r + $_NY * weights_by_p_column[k]] += by_h[r + $_NY * t] * next.z[tap_signal[t]][l] * of_weights[k];
        }
    }
    for (k = 0; k < $_NY * $_SEEN; k++) {
        newest[k] += by_now[k];
    }
    seen_by(window->y[0], window->actuators, u, next.p, sees_by_y, sees_by_u);
    for (r = 0; r < $_NY; r++) {
        for (j = 0; j < $_NY; j++) {
            by_y[r + $_NY * j] = 0.0;
            for (i = 0; i < $_SEEN; i++) {
                by_y[r + $_NY * j] += newest[r + $_NY * i] * sees_by_y[i + $_SEEN * j];
            }
        }
        for (j = 0; j < $_NU; j++) {
            by_u[r + $_NY * j] = 0.0;
            for (i = 0; i < $_SEEN; i++) {
                by_u[r + $_NY * j] += newest[r + $_NY * i] * sees_by_u[i + $_SEEN * j];
            }
        }
    }
}
