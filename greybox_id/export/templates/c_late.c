/* which delay each input has; -1: none */
static const int @_delay_of[$_NU] = {@PLACES@};

void @_commands_start(@_commands *line, const double *u)
{
    line->time[0] = -HUGE_VAL;
    memcpy(line->u[0], u, sizeof line->u[0]);
    line->count = 1;
}

int @_commands_push(@_commands *line, double time, const double *u)
{
    const size_t place = line->count % $_COMMANDS;
    if (!(time > line->time[(line->count - 1) % $_COMMANDS])) {
        return -1;
    }
    line->time[place] = time;
    memcpy(line->u[place], u, sizeof line->u[place]);
    line->count++;
    return 0;
}

/* what input i is at a time, and when it changes next; -1 where the line does not reach back */
static int @_command_at(const @_commands *line, size_t i, double time, double *u, double *until)
{
    const size_t held = line->count < $_COMMANDS ? line->count : $_COMMANDS;
    size_t back = 0;
    *until = HUGE_VAL;
    while (back + 1 < held && line->time[(line->count - 1 - back) % $_COMMANDS] > time) {
        *until = line->time[(line->count - 1 - back) % $_COMMANDS];
        back++;
    }
    *u = line->u[(line->count - 1 - back) % $_COMMANDS][i];
    return line->time[(line->count - 1 - back) % $_COMMANDS] > time ? -1 : 0;
}

int @_commands_until(const @_commands *line, const double *p, double time, double *u, double *on)
{
    double late[@COUNT@];
    size_t i;
    int found = 0;
    @_delays(p, late);
    *on = HUGE_VAL;
    for (i = 0; i < $_NU; i++) {
        const double delay = @_delay_of[i] < 0 ? 0.0 : late[@_delay_of[i]];
        double until;
        if (@_command_at(line, i, time - delay, &u[i], &until) != 0) {
            found = -1;
        }
        if (until - (time - delay) < *on) {
            *on = until - (time - delay);
        }
    }
    return found;
}

int @_commands_acting(const @_commands *line, const double *p, double time, double *u)
{
    double on;
    return @_commands_until(line, p, time, u, &on);
}

int @_step_late(const @_commands *line, const double *x, const double *p, double time, double dt,
    double *x_next)
{
    const double end = time + dt, soon = 1e-9 * dt; /* commands a billionth of a step apart act as one */
    double now[$_NX], u[$_NU], on;
    int found = 0;
    memcpy(now, x, sizeof now);
    while (end - time > soon) {
        double h = end - time;
        if (@_commands_until(line, p, time + soon, u, &on) != 0) {
            found = -1;
        }
        if (on + soon < h) {
            h = on + soon;
        }
        @_step(now, u, p, h, now);
        time += h;
    }
    memcpy(x_next, now, sizeof now);
    return found;
}
