
/* Continuous states and their derivatives; there are no events. */

#define STATES (@STATES@u)
#define FIRST_STATE (@FIRST_STATE@u)
#define FIRST_DERIVATIVE (@FIRST_DERIVATIVE@u)
#define INPUTS (@INPUTS@u)
#define OUTPUTS (@OUTPUTS@u)

/** Outputs and derivatives at the present states and inputs. */
static void look(Instance *m)
{
    @NAME@_derivatives(&m->p, &m->s, &m->u, &m->dx, &m->y);
}

static @FMI@Status set_states(Instance *m, const @REAL@ x[], size_t n)
{
    if (n != STATES) {
        return complain(m, "another number of states");
    }
    for (@FMI@ValueReference i = 0; i < STATES; i++) {
        *variable(m, FIRST_STATE + i) = (@NAME@_real)x[i];
    }
    return @FMI@OK;
}

/** States, or from FIRST_DERIVATIVE on their derivatives, as `look` left them. */
static @FMI@Status get_states(Instance *m, @FMI@ValueReference first, @REAL@ x[], size_t n)
{
    if (n != STATES) {
        return complain(m, "another number of states");
    }
    for (@FMI@ValueReference i = 0; i < STATES; i++) {
        x[i] = (@REAL@)*variable(m, first + i);
    }
    return @FMI@OK;
}

static @FMI@Status unit_nominals(@REAL@ x[], size_t n)
{
    for (size_t i = 0; i < n; i++) {
        x[i] = 1.0;
    }
    return @FMI@OK;
}

/** Whether a variable is an input or a state, with respect to which there are derivatives. */
static int known(@FMI@ValueReference vr)
{
    return (vr < INPUTS) || ((vr >= FIRST_STATE) && (vr < (FIRST_STATE + STATES)));
}

/** Whether a variable is an output or the derivative of a state. */
static int unknown(@FMI@ValueReference vr)
{
    return ((vr >= INPUTS) && (vr < (INPUTS + OUTPUTS))) ||
           ((vr >= FIRST_DERIVATIVE) && (vr < (FIRST_DERIVATIVE + STATES)));
}

static @FMI@Status directional(Instance *m, const @FMI@ValueReference unknowns[], size_t n_unknowns,
                              const @FMI@ValueReference knowns[], size_t n_knowns, const @REAL@ seed[],
                              @REAL@ sensitivity[])
{
    Instance way;
    memset(&way, 0, sizeof(way));
    for (size_t i = 0; i < n_knowns; i++) {
        if (known(knowns[i]) == 0) {
            return complain(m, "derivatives are with respect to inputs and states");
        }
        *variable(&way, knowns[i]) = (@NAME@_real)seed[i];
    }
    @NAME@_directional(&m->p, &m->s, &m->u, &way.s, &way.u, &m->dx, &m->y, &way.dx, &way.y);
    for (size_t i = 0; i < n_unknowns; i++) {
        if (unknown(unknowns[i]) == 0) {
            return complain(m, "derivatives are of outputs and of the derivatives of states");
        }
        sensitivity[i] = (@REAL@)*variable(&way, unknowns[i]);
    }
    return @FMI@OK;
}
