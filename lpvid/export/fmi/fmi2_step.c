
/* One step of the model per communication step of @PERIOD@ s, or several; inputs are held meanwhile. */

/** Outputs of the present states and inputs; the states stay. */
static void look(Instance *m)
{
    @NAME@_states ahead = m->s;
    @NAME@_step(&m->p, &ahead, &m->u, &m->y);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return (nvr == 0u) ? fmi2OK : complain((Instance *)c, "inputs are held, not interpolated");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return (nvr == 0u) ? fmi2OK : complain((Instance *)c, "outputs have no derivatives");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    Instance *m = (Instance *)c;
    const fmi2Real period = @PERIOD@;
    const fmi2Real samples = communicationStepSize / period;
    (void)currentCommunicationPoint;
    (void)noSetFMUStatePriorToCurrentPoint;
    if (!(samples > 0.5) || !(samples < 1e9)) {
        return complain(m, "the communication step is shorter than the model's period");
    }
    const long count = (long)(samples + 0.5);
    const fmi2Real off = samples - (fmi2Real)count;
    if ((off > 1e-6 * samples) || (off < -1e-6 * samples)) {
        return complain(m, "the communication step is no multiple of the model's period, @PERIOD@ s");
    }
    for (long k = 0; k < count; k++) {
        @NAME@_step(&m->p, &m->s, &m->u, &m->y);
    }
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return complain((Instance *)c, "a step is over when it returns");
}

#define STATUS(kind, type)                                                                                           \
    fmi2Status fmi2Get##kind(fmi2Component c, const fmi2StatusKind s, type *value)                                   \
    {                                                                                                                \
        (void)c;                                                                                                     \
        (void)s;                                                                                                     \
        (void)value;                                                                                                 \
        return fmi2Discard;                                                                                          \
    }
STATUS(Status, fmi2Status)
STATUS(RealStatus, fmi2Real)
STATUS(IntegerStatus, fmi2Integer)
STATUS(BooleanStatus, fmi2Boolean)
STATUS(StringStatus, fmi2String)

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown,
                                        const fmi2Real dvKnown[], fmi2Real dvUnknown[])
{
    (void)vUnknown_ref;
    (void)nUnknown;
    (void)vKnown_ref;
    (void)nKnown;
    (void)dvKnown;
    (void)dvUnknown;
    return complain((Instance *)c, "there are no directional derivatives");
}
