/* FMI 2.0 for co-simulation around @NAME@.c; the few types of the standard that it needs are declared here. */
#include <string.h>

#include "@NAME@.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

typedef enum { OK, WARNING, DISCARD, ERROR_, FATAL, PENDING } status_t;
typedef unsigned int reference_t;
typedef void (*logger_t)(void *, const char *, status_t, const char *, const char *, ...);
typedef struct {
    logger_t logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, status_t);
    void *environment;
} callbacks_t;

enum { PRESSURE, TIP_X, TIP_Y, ANGLE, FLOW, LAST_CHANGE, VARIABLES };

typedef struct {
    @NAME@_t model;
    @NAME@_output_t output;
    double pressure, before;
    int running;
    const callbacks_t *callbacks;
} instance_t;

static status_t failed(instance_t *item, const char *message) {
    if (item->callbacks->logger)
        item->callbacks->logger(item->callbacks->environment, "@NAME@", ERROR_, "logStatusError", message);
    return ERROR_;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT status_t fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *categories) {
    (void)c, (void)on, (void)n, (void)categories;
    return OK;
}

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                             const callbacks_t *callbacks, int visible, int logging) {
    (void)name, (void)resources, (void)visible, (void)logging;
    if (type != 1 || !callbacks || !callbacks->allocate || !guid || strcmp(guid, "@GUID@") != 0) return 0;
    instance_t *item = callbacks->allocate(1, sizeof(instance_t));
    if (!item) return 0;
    memset(item, 0, sizeof *item);
    item->callbacks = callbacks;
    return item;
}
EXPORT void fmi2FreeInstance(void *c) {
    if (c && ((instance_t *)c)->callbacks->release) ((instance_t *)c)->callbacks->release(c);
}
EXPORT status_t fmi2SetupExperiment(void *c, int known, double tolerance, double start, int ends, double stop) {
    (void)c, (void)known, (void)tolerance, (void)start, (void)ends, (void)stop;
    return OK;
}
EXPORT status_t fmi2EnterInitializationMode(void *c) {
    (void)c;
    return OK;
}
/* At rest at the pressure as it stands: outputs may be asked for before initialisation ends. */
static status_t at_rest(instance_t *item) {
    item->before = item->pressure;
    if (@NAME@_init(&item->model, item->pressure, &item->output))
        return failed(item, "no stable static equilibrium at the first pressure; start from a lower one");
    return OK;
}
EXPORT status_t fmi2ExitInitializationMode(void *c) {
    instance_t *item = c;
    item->running = 1;
    return at_rest(item);
}
EXPORT status_t fmi2Terminate(void *c) {
    (void)c;
    return OK;
}
EXPORT status_t fmi2Reset(void *c) {
    instance_t *item = c;
    const callbacks_t *callbacks = item->callbacks;
    memset(item, 0, sizeof *item);
    item->callbacks = callbacks;
    return OK;
}

EXPORT status_t fmi2GetReal(void *c, const reference_t *which, size_t n, double *values) {
    instance_t *item = c;
    if (!item->running && at_rest(item) != OK) return ERROR_;
    for (size_t k = 0; k < n; k++) {
        switch (which[k]) {
        case PRESSURE: values[k] = item->pressure; break;
        case TIP_X: values[k] = item->output.tip_x_m; break;
        case TIP_Y: values[k] = item->output.tip_y_m; break;
        case ANGLE: values[k] = item->output.angle_rad; break;
        case FLOW: values[k] = item->output.flow_m3_s; break;
        case LAST_CHANGE: values[k] = item->model.last_change; break;
        default: return failed(item, "there is no such variable");
        }
    }
    return OK;
}
EXPORT status_t fmi2SetReal(void *c, const reference_t *which, size_t n, const double *values) {
    for (size_t k = 0; k < n; k++) {
        if (which[k] != PRESSURE) return failed(c, "only the pressure is an input");
        ((instance_t *)c)->pressure = values[k];
    }
    return OK;
}

/* The input is the pressure at the end of the communication step, linear since the last one. */
EXPORT status_t fmi2DoStep(void *c, double now, double length, int final) {
    instance_t *item = c;
    const double wanted = length / @NAME_UPPER@_STEP_S, from = item->before;
    const long count = (long)(wanted + 0.5);
    (void)now, (void)final;
    if (count < 1 || wanted - count > 1e-6 || count - wanted > 1e-6)
        return failed(item, "the communication step must be a whole multiple of @STEP_S@ s");
    for (long k = 1; k <= count; k++)
        if (@NAME@_step(&item->model, from + (item->pressure - from) * ((double)k / count), &item->output))
            return failed(item, "Newton's method did not settle; use a smaller step");
    item->before = item->pressure;
    return OK;
}
EXPORT status_t fmi2CancelStep(void *c) { return failed(c, "steps are not asynchronous"); }

#define NONE(name, arguments)                  \
    EXPORT status_t name arguments {           \
        return n == 0 ? OK : failed(c, #name); \
    }
NONE(fmi2GetInteger, (void *c, const reference_t *which, size_t n, int *values))
NONE(fmi2GetBoolean, (void *c, const reference_t *which, size_t n, int *values))
NONE(fmi2GetString, (void *c, const reference_t *which, size_t n, const char **values))
NONE(fmi2SetInteger, (void *c, const reference_t *which, size_t n, const int *values))
NONE(fmi2SetBoolean, (void *c, const reference_t *which, size_t n, const int *values))
NONE(fmi2SetString, (void *c, const reference_t *which, size_t n, const char *const *values))
NONE(fmi2SetRealInputDerivatives,
     (void *c, const reference_t *which, size_t n, const int *order, const double *values))
NONE(fmi2GetRealOutputDerivatives, (void *c, const reference_t *which, size_t n, const int *order, double *values))

#define NEVER(name, arguments) \
    EXPORT status_t name arguments { return failed(c, #name " is not offered"); }
NEVER(fmi2GetDirectionalDerivative, (void *c, const reference_t *of, size_t m, const reference_t *by, size_t n,
                                     const double *seed, double *values))
NEVER(fmi2GetFMUstate, (void *c, void **state))
NEVER(fmi2SetFMUstate, (void *c, void *state))
NEVER(fmi2FreeFMUstate, (void *c, void **state))
NEVER(fmi2SerializedFMUstateSize, (void *c, void *state, size_t *size))
NEVER(fmi2SerializeFMUstate, (void *c, void *state, char *bytes, size_t size))
NEVER(fmi2DeSerializeFMUstate, (void *c, const char *bytes, size_t size, void **state))
NEVER(fmi2GetStatus, (void *c, int kind, status_t *value))
NEVER(fmi2GetRealStatus, (void *c, int kind, double *value))
NEVER(fmi2GetIntegerStatus, (void *c, int kind, int *value))
NEVER(fmi2GetBooleanStatus, (void *c, int kind, int *value))
NEVER(fmi2GetStringStatus, (void *c, int kind, const char **value))
