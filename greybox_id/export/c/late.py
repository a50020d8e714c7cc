"""Commands that arrive late, in C: a line of past commands, and steps that are cut where a late one arrives."""

from __future__ import annotations

from ..equations import Equations
from .naming import constant

CAPACITY = 256
"""Commands that are remembered."""


def late_declarations(own: str, equations: Equations, capacity: int = CAPACITY) -> str:
    """For the header; so many commands are remembered."""
    n, size = constant(own, "NU"), constant(own, "COMMANDS")
    signals = ", ".join(equations.delayed)
    return f"""\
/* Commands arrive late here: {signals}. {own}_step takes the inputs as they act; {own}_step_late takes them
   from a line of past commands and cuts its step where a late one arrives, so that a delay of 3.7 samples is exact.

   {own}_commands_start   one command since ever.
   {own}_commands_push    a command that holds from a time on, later than the one before. Returns 0; -1 if it is not.
   {own}_commands_acting  the inputs that act at a time.
   {own}_commands_until   the same, and how many seconds they go on.
   {own}_step_late        the state at time + dt from that at time; x_next may be x. Returns 0; -1 where the line does
                          not reach back far enough and its oldest command was taken. */
#define {size} {capacity}

typedef struct {{
    double time[{size}];
    double u[{size}][{n}];
    size_t count; /* commands so far */
}} {own}_commands;

void {own}_commands_start({own}_commands *line, const double *u);
int {own}_commands_push({own}_commands *line, double time, const double *u);
int {own}_commands_acting(const {own}_commands *line, const double *p, double time, double *u);
int {own}_commands_until(const {own}_commands *line, const double *p, double time, double *u, double *on);
int {own}_step_late(const {own}_commands *line, const double *x, const double *p, double time, double dt,
    double *x_next);
"""


def late_definitions(own: str, equations: Equations) -> str:
    """For the source."""
    n, m, size = (constant(own, word) for word in ("NX", "NU", "COMMANDS"))
    places = [equations.delayed.index(i.name) if i.name in equations.delayed else -1 for i in equations.inputs]
    count = len(equations.delayed)
    return f"""\
/* which delay each input has; -1: none */
static const int {own}_delay_of[{m}] = {{{", ".join(map(str, places))}}};

void {own}_commands_start({own}_commands *line, const double *u)
{{
    line->time[0] = -HUGE_VAL;
    memcpy(line->u[0], u, sizeof line->u[0]);
    line->count = 1;
}}

int {own}_commands_push({own}_commands *line, double time, const double *u)
{{
    const size_t place = line->count % {size};
    if (!(time > line->time[(line->count - 1) % {size}])) {{
        return -1;
    }}
    line->time[place] = time;
    memcpy(line->u[place], u, sizeof line->u[place]);
    line->count++;
    return 0;
}}

/* what input i is at a time, and when it changes next; -1 where the line does not reach back */
static int {own}_command_at(const {own}_commands *line, size_t i, double time, double *u, double *until)
{{
    const size_t held = line->count < {size} ? line->count : {size};
    size_t back = 0;
    *until = HUGE_VAL;
    while (back + 1 < held && line->time[(line->count - 1 - back) % {size}] > time) {{
        *until = line->time[(line->count - 1 - back) % {size}];
        back++;
    }}
    *u = line->u[(line->count - 1 - back) % {size}][i];
    return line->time[(line->count - 1 - back) % {size}] > time ? -1 : 0;
}}

int {own}_commands_until(const {own}_commands *line, const double *p, double time, double *u, double *on)
{{
    double late[{count}];
    size_t i;
    int found = 0;
    {own}_delays(p, late);
    *on = HUGE_VAL;
    for (i = 0; i < {m}; i++) {{
        const double delay = {own}_delay_of[i] < 0 ? 0.0 : late[{own}_delay_of[i]];
        double until;
        if ({own}_command_at(line, i, time - delay, &u[i], &until) != 0) {{
            found = -1;
        }}
        if (until - (time - delay) < *on) {{
            *on = until - (time - delay);
        }}
    }}
    return found;
}}

int {own}_commands_acting(const {own}_commands *line, const double *p, double time, double *u)
{{
    double on;
    return {own}_commands_until(line, p, time, u, &on);
}}

int {own}_step_late(const {own}_commands *line, const double *x, const double *p, double time, double dt,
    double *x_next)
{{
    const double end = time + dt, soon = 1e-9 * dt; /* commands a billionth of a step apart act as one */
    double now[{n}], u[{m}], on;
    int found = 0;
    memcpy(now, x, sizeof now);
    while (end - time > soon) {{
        double h = end - time;
        if ({own}_commands_until(line, p, time + soon, u, &on) != 0) {{
            found = -1;
        }}
        if (on + soon < h) {{
            h = on + soon;
        }}
        {own}_step(now, u, p, h, now);
        time += h;
    }}
    memcpy(x_next, now, sizeof now);
    return found;
}}
"""
