
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

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    (void)c;
    info->newDiscreteStatesNeeded = fmi2False;
    info->terminateSimulation = fmi2False;
    info->nominalsOfContinuousStatesChanged = fmi2False;
    info->valuesOfContinuousStatesChanged = fmi2False;
    info->nextEventTimeDefined = fmi2False;
    info->nextEventTime = 0.0;
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation)
{
    (void)c;
    (void)noSetFMUStatePriorToCurrentPoint;
    *enterEventMode = fmi2False;
    *terminateSimulation = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    (void)c;
    (void)time;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx)
{
    Instance *m = (Instance *)c;
    if (nx != STATES) {
        return complain(m, "another number of states");
    }
    for (fmi2ValueReference i = 0; i < STATES; i++) {
        *variable(m, FIRST_STATE + i) = (@NAME@_real)x[i];
    }
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx)
{
    Instance *m = (Instance *)c;
    if (nx != STATES) {
        return complain(m, "another number of states");
    }
    for (fmi2ValueReference i = 0; i < STATES; i++) {
        x[i] = (fmi2Real)*variable(m, FIRST_STATE + i);
    }
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx)
{
    Instance *m = (Instance *)c;
    if (nx != STATES) {
        return complain(m, "another number of states");
    }
    look(m);
    for (fmi2ValueReference i = 0; i < STATES; i++) {
        derivatives[i] = (fmi2Real)*variable(m, FIRST_DERIVATIVE + i);
    }
    return fmi2OK;
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni)
{
    (void)eventIndicators;
    return (ni == 0u) ? fmi2OK : complain((Instance *)c, "there are no event indicators");
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x_nominal[], size_t nx)
{
    (void)c;
    for (size_t i = 0; i < nx; i++) {
        x_nominal[i] = 1.0;
    }
    return fmi2OK;
}

/** Whether a variable is an input or a state, with respect to which there are derivatives. */
static int known(fmi2ValueReference vr)
{
    return (vr < INPUTS) || ((vr >= FIRST_STATE) && (vr < (FIRST_STATE + STATES)));
}

/** Whether a variable is an output or the derivative of a state. */
static int unknown(fmi2ValueReference vr)
{
    return ((vr >= INPUTS) && (vr < (INPUTS + OUTPUTS))) ||
           ((vr >= FIRST_DERIVATIVE) && (vr < (FIRST_DERIVATIVE + STATES)));
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown,
                                        const fmi2Real dvKnown[], fmi2Real dvUnknown[])
{
    Instance *m = (Instance *)c;
    Instance way;
    memset(&way, 0, sizeof(way));
    for (size_t i = 0; i < nKnown; i++) {
        if (known(vKnown_ref[i]) == 0) {
            return complain(m, "derivatives are with respect to inputs and states");
        }
        *variable(&way, vKnown_ref[i]) = (@NAME@_real)dvKnown[i];
    }
    @NAME@_directional(&m->p, &m->s, &m->u, &way.s, &way.u, &m->dx, &m->y, &way.dx, &way.y);
    for (size_t i = 0; i < nUnknown; i++) {
        if (unknown(vUnknown_ref[i]) == 0) {
            return complain(m, "derivatives are of outputs and of the derivatives of states");
        }
        dvUnknown[i] = (fmi2Real)*variable(&way, vUnknown_ref[i]);
    }
    return fmi2OK;
}
