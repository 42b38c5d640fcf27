
const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[])
{
    (void)instance;
    (void)loggingOn;
    (void)nCategories;
    (void)categories;
    return fmi3OK;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    ((Instance *)instance)->time = startTime;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    begin((Instance *)instance);
    return fmi3OK;
}

#define PLAIN(name)                                                                                                  \
    fmi3Status name(fmi3Instance instance)                                                                           \
    {                                                                                                                \
        (void)instance;                                                                                              \
        return fmi3OK;                                                                                               \
    }
PLAIN(fmi3Terminate)

fmi3Status fmi3Reset(fmi3Instance instance)
{
    start((Instance *)instance);
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Float64 values[], size_t nValues)
{
    if (nValues != nValueReferences) {
        return complain((Instance *)instance, "every variable is a scalar");
    }
    return get_values((Instance *)instance, valueReferences, nValueReferences, values);
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Float64 values[], size_t nValues)
{
    if (nValues != nValueReferences) {
        return complain((Instance *)instance, "every variable is a scalar");
    }
    return set_values((Instance *)instance, valueReferences, nValueReferences, values);
}

#define NONE(get, set, type)                                                                                          \
    fmi3Status get(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, type values[], size_t nValues)     \
    {                                                                                                                 \
        (void)vr;                                                                                                     \
        (void)values;                                                                                                 \
        (void)nValues;                                                                                                \
        return (n == 0u) ? fmi3OK : complain((Instance *)instance, "there are variables of type Float64 only");       \
    }                                                                                                                 \
    fmi3Status set(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const type values[], size_t nValues)\
    {                                                                                                                 \
        (void)vr;                                                                                                     \
        (void)values;                                                                                                 \
        (void)nValues;                                                                                                \
        return (n == 0u) ? fmi3OK : complain((Instance *)instance, "there are variables of type Float64 only");       \
    }
NONE(fmi3GetFloat32, fmi3SetFloat32, fmi3Float32)
NONE(fmi3GetInt8, fmi3SetInt8, fmi3Int8)
NONE(fmi3GetUInt8, fmi3SetUInt8, fmi3UInt8)
NONE(fmi3GetInt16, fmi3SetInt16, fmi3Int16)
NONE(fmi3GetUInt16, fmi3SetUInt16, fmi3UInt16)
NONE(fmi3GetInt32, fmi3SetInt32, fmi3Int32)
NONE(fmi3GetUInt32, fmi3SetUInt32, fmi3UInt32)
NONE(fmi3GetInt64, fmi3SetInt64, fmi3Int64)
NONE(fmi3GetUInt64, fmi3SetUInt64, fmi3UInt64)
NONE(fmi3GetBoolean, fmi3SetBoolean, fmi3Boolean)
NONE(fmi3GetString, fmi3SetString, fmi3String)

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    return copy_state((Instance *)instance, FMUState);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState)
{
    return restore_state((Instance *)instance, FMUState);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    (void)instance;
    return free_state(FMUState);
}
