/* car: kinematic single-track vehicle with an understeer gradient (kinematic), from fit, greybox-id 1.0.0rc1.

   x is the state, u what is commanded or measured of the inputs, held over a step, p the parameters, y
   what sensors read. SI units throughout; angles to the left are positive (ISO 8855). Matrices are dense,
   column after column: by_x[row + rows * column]. No function keeps anything, takes memory from the heap or
   calls more than the mathematical library; all may run at the same time. x_next may be x; other results
   have places of their own. Stack: at most 1344 bytes. */

#ifndef CAR_H
#define CAR_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* State */
#define CAR_NX 1
#define CAR_X_YAW_RATE       0 /* rad/s, yaw rate */
#define CAR_X_YAW_RATE_UNIT  "rad/s"

/* Inputs */
#define CAR_NU 2
#define CAR_U_STEER       0 /* rad, road-wheel steering angle */
#define CAR_U_STEER_UNIT  "rad"
#define CAR_U_V_X         1 /* m/s, longitudinal velocity */
#define CAR_U_V_X_UNIT    "m/s"

/* Parameters */
#define CAR_NP 5
#define CAR_P_L_F                  0 /* m, front axle to centre of gravity */
#define CAR_P_L_F_UNIT             "m"
#define CAR_P_L_R                  1 /* m, rear axle to centre of gravity */
#define CAR_P_L_R_UNIT             "m"
#define CAR_P_YAW_LAG              2 /* s, time constant of the yaw rate */
#define CAR_P_YAW_LAG_UNIT         "s"
#define CAR_P_K_US                 3 /* rad s^2/m, understeer gradient */
#define CAR_P_K_US_UNIT            "rad s^2/m"
#define CAR_P_STEERING_DELAY       4 /* s, pure delay of the steering command */
#define CAR_P_STEERING_DELAY_UNIT  "s"

/* Outputs */
#define CAR_NY 2
#define CAR_Y_YAW_RATE       0 /* rad/s */
#define CAR_Y_YAW_RATE_UNIT  "rad/s"
#define CAR_Y_A_Y            1 /* m/s^2 */
#define CAR_Y_A_Y_UNIT       "m/s^2"

extern const double car_default_parameters[];
extern const char *const car_state_names[];
extern const char *const car_input_names[];
extern const char *const car_parameter_names[];
extern const char *const car_output_names[];

/* The state dt [s] later. One step of the classical Runge-Kutta method; lags and limits of actuators are exact.
   Lengths: x CAR_NX, u CAR_NU, p CAR_NP, x_next CAR_NX. */
void car_step(const double *x, const double *u, const double *p, double dt, double *x_next);

/* The state dt [s] later and its derivatives by state and inputs.
   Lengths: x CAR_NX, u CAR_NU, p CAR_NP, x_next CAR_NX, by_x CAR_NX x CAR_NX, by_u CAR_NX x CAR_NU. */
void car_step_jacobian(const double *x, const double *u, const double *p, double dt, double *x_next,
    double *by_x, double *by_u);

/* The derivative of the state dt [s] later by the parameters.
   Lengths: x CAR_NX, u CAR_NU, p CAR_NP, by_p CAR_NX x CAR_NP. */
void car_step_by_p(const double *x, const double *u, const double *p, double dt, double *by_p);

/* The derivative of the state.
   Lengths: x CAR_NX, u CAR_NU, p CAR_NP, x_dot CAR_NX. */
void car_ode(const double *x, const double *u, const double *p, double *x_dot);

/* The derivative of the state, and its derivatives by state and inputs.
   Lengths: x CAR_NX, u CAR_NU, p CAR_NP, x_dot CAR_NX, by_x CAR_NX x CAR_NX, by_u CAR_NX x CAR_NU. */
void car_ode_jacobian(const double *x, const double *u, const double *p, double *x_dot,
    double *by_x, double *by_u);

/* What sensors read, but for their latency.
   Lengths: x CAR_NX, u CAR_NU, p CAR_NP, y CAR_NY. */
void car_output(const double *x, const double *u, const double *p, double *y);

/* What sensors read, and its derivatives by state and inputs.
   Lengths: x CAR_NX, u CAR_NU, p CAR_NP, y CAR_NY, by_x CAR_NY x CAR_NX, by_u CAR_NY x CAR_NU. */
void car_output_jacobian(const double *x, const double *u, const double *p, double *y, double *by_x,
    double *by_u);

/* By how many seconds these are late: steer.
   Lengths: p CAR_NP, s 1. */
void car_delays(const double *p, double *s);

/* The derivative of the state, and those of its sensitivities by state and inputs at the beginning:
   by_x S_x, and by_x S_u + by_u. Lengths: S_x CAR_NX x CAR_NX, S_u CAR_NX x CAR_NU. */
void car_vde_forw(const double *x, const double *S_x, const double *S_u, const double *u,
    const double *p, double *x_dot, double *S_x_dot, double *S_u_dot);

/* Commands arrive late here: steer. car_step takes the inputs as they act; car_step_late takes them
   from a line of past commands and cuts its step where a late one arrives, so that a delay of 3.7 samples is exact.

   car_commands_start   one command since ever.
   car_commands_push    a command that holds from a time on, later than the one before. Returns 0; -1 if it is not.
   car_commands_acting  the inputs that act at a time.
   car_commands_until   the same, and how many seconds they go on.
   car_step_late        the state at time + dt from that at time; x_next may be x. Returns 0; -1 where the line does
                          not reach back far enough and its oldest command was taken. */
#define CAR_COMMANDS 256

typedef struct {
    double time[CAR_COMMANDS];
    double u[CAR_COMMANDS][CAR_NU];
    size_t count; /* commands so far */
} car_commands;

void car_commands_start(car_commands *line, const double *u);
int car_commands_push(car_commands *line, double time, const double *u);
int car_commands_acting(const car_commands *line, const double *p, double time, double *u);
int car_commands_until(const car_commands *line, const double *p, double time, double *u, double *on);
int car_step_late(const car_commands *line, const double *x, const double *p, double time, double dt,
    double *x_next);

#ifdef __cplusplus
}
#endif

#endif
