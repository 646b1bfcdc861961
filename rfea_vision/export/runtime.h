/* @ABOUT@
 *
 * The tube in real time: C99, no dependence but math.h and string.h, no allocation, no hidden state.
 * A step takes @NEWTON_ITERATIONS@ Newton iterations in each of its two stages, whatever the motion. */
#ifndef @NAME_UPPER@_H
#define @NAME_UPPER@_H

#ifdef __cplusplus
extern "C" {
#endif

#define @NAME_UPPER@_STEP_S @STEP_S@
#define @NAME_UPPER@_NEWTON_ITERATIONS @NEWTON_ITERATIONS@

typedef struct {
    double phi[@N@ + 1];          /* rad, absolute angles, the clamp first */
    double rate[@N@ + 1];         /* rad/s */
    double acceleration[@N@ + 1]; /* rad/s^2 */
    double z[@N@][@STATES@];           /* hidden states of each joint */
    double at_gauge, in_tube;   /* Pa, at the end of the last step */
    double last_change;         /* rad, what the last Newton iteration still changed */
} @NAME@_t;

typedef struct {
    double tip_x_m, tip_y_m; /* tip of the centre line; origin at the clamp, x to the camera's right, y up */
    double angle_rad;        /* direction of the tip, 0 hanging, positive towards the bend */
    double flow_m3_s;        /* into the tube */
} @NAME@_output_t;

/* At rest in the static equilibrium at a pressure (Pa, gauge). 0, or 1 where there is no stable one. */
int @NAME@_init(@NAME@_t *model, double pressure_Pa, @NAME@_output_t *output);

/* One step of @STEP_S@ s; the pressure is that at its end, linear since the last one.
 * 0, or 1 where Newton's method has not settled (the last change is above 1e-5 rad, or not a number). */
int @NAME@_step(@NAME@_t *model, double pressure_Pa, @NAME@_output_t *output);

#ifdef __cplusplus
}
#endif
#endif
