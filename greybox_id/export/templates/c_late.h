/* Commands arrive late here: @SIGNALS@. @_step takes the inputs as they act; @_step_late takes them
   from a line of past commands and cuts its step where a late one arrives, so that a delay of 3.7 samples is exact.

   @_commands_start   one command since ever.
   @_commands_push    a command that holds from a time on, later than the one before. Returns 0; -1 if it is not.
   @_commands_acting  the inputs that act at a time.
   @_commands_until   the same, and how many seconds they go on.
   @_step_late        the state at time + dt from that at time; x_next may be x. Returns 0; -1 where the line does
                          not reach back far enough and its oldest command was taken. */
#define $_COMMANDS @CAPACITY@

typedef struct {
    double time[$_COMMANDS];
    double u[$_COMMANDS][$_NU];
    size_t count; /* commands so far */
} @_commands;

void @_commands_start(@_commands *line, const double *u);
int @_commands_push(@_commands *line, double time, const double *u);
int @_commands_acting(const @_commands *line, const double *p, double time, double *u);
int @_commands_until(const @_commands *line, const double *p, double time, double *u, double *on);
int @_step_late(const @_commands *line, const double *x, const double *p, double time, double dt,
    double *x_next);
