
/* One step of the model per communication step of @PERIOD@ s, or several; inputs are held meanwhile. */

/** Outputs of the present states and inputs; the states stay. */
static void look(Instance *m)
{
    @NAME@_states next = m->s;
    @NAME@_step(&m->p, &next, &m->u, &m->y);
}

static @FMI@Status advance(Instance *m, @REAL@ communication_step)
{
    const @REAL@ period = @PERIOD@;
    const @REAL@ samples = communication_step / period;
    if (!(samples > 0.5) || !(samples < 1e9)) {
        return complain(m, "the communication step is shorter than the model's period");
    }
    const long count = (long)(samples + 0.5);
    const @REAL@ off = samples - (@REAL@)count;
    if ((off > 1e-6 * samples) || (off < -1e-6 * samples)) {
        return complain(m, "the communication step is no multiple of the model's period, @PERIOD@ s");
    }
    for (long k = 0; k < count; k++) {
        @NAME@_step(&m->p, &m->s, &m->u, &m->y);
    }
    return @FMI@OK;
}
