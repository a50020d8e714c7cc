
typedef struct {
    double p[$_NP + 1];
    double weights[$_TAPS][$_MEMORY];  /* of past signals, oldest first */
    double actuators[$_ACTUATORS];
    double y[$_PAST][$_NY];            /* predictions, newest first */
    double u[$_MEMORY][$_SEEN];        /* inputs as the equations saw them, oldest first */
    double z[$_SIGNALS][$_MEMORY];     /* signals made of them */
} @_window;

/* A window as though inputs and readings had stood there since ever. Actuators begin at their commands' value. */
void @_start(@_window *window, const double *p, const double *u, const double *y);

/* A sample is added whose outputs a sample later were read: y. Fills a window before it runs alone. */
void @_push(@_window *window, const double *u, const double *y);

/* A sample later, on its own predictions. */
void @_step(@_window *window, const double *u);

/* What sensors read now. */
void @_output(const @_window *window, double *y);

/* What @_step would predict, y_next ($_NY), and its derivatives by the inputs that the equations see now and
   saw before, by_window ($_NY x $_SEEN x $_MEMORY, oldest sample first, the newest as it will be seen), by the
   inputs handed in, by_u ($_NY x $_NU), the predictions now, by_y ($_NY x $_NY), and the parameters of the
   equations, by_p ($_NY x $_NP). */
void @_step_jacobian(const @_window *window, const double *u, double *y_next, double *by_window, double *by_u,
    double *by_y, double *by_p);
