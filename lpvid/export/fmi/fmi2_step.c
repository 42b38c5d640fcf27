
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
    (void)currentCommunicationPoint;
    (void)noSetFMUStatePriorToCurrentPoint;
    return advance((Instance *)c, communicationStepSize);
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
