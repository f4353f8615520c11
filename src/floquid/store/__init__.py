"""Results on the disk: `result.h5`, read back whole by `load`.

`result.h5` is an HDF5 file, so MATLAB, Julia and others read it too. Nothing in it is code: loading runs nothing.

Attributes of the file: `format` is "floquid-result", `version` is 4, `floquid` is the version of floquid that wrote it.
Every array names its `axes`, slowest first (as C and Python have them), and its `unit` if it has one. Real
numbers are float64, integers int64, texts UTF-8. A complex number is a compound of float64 `r` and `i`. A dataset
without content (a null dataspace) stands for None: "not estimated", or "not given". The datasets are::

    /findings                       what was done and what a reader must know: JSON, as in summary.json
    /shafts/hit1, hit2, .../        the angle of the shaft where it was measured: the pulses' times, residuals, lines
                                    and kept, jitter, rounded (absent of files before there was one), geometry, counts,
                                    wander, steady, findings, and spline/ (first, last, slope, knots, coefficients,
                                    degree, covariance)
    /settings/                      period, channels, order, harmonics, ...: one dataset a field of `Settings`
    /records/hit1, hit2, .../       the records used, as they were measured: values (channels, samples), sample_rate,
                                    start, period and origin of the clock, or clock/ in place of a constant period
                                    that was given (kind, channel or times, pulses and periods per revolution; period,
                                    origin and fitted), orbit where there is one, channels/, provenance/, point/ (the
                                    operating point: speed_rpm, ...)
    /model/                         exponents (modes,), coefficients (modes, channels, hits, harmonics), harmonics,
                                    period, covariance, coefficient_std, channels/, provenance/, point/ (absent of files
                                    before there was one); inputs/ where some were
                                    measured: channels/, coefficients (modes, inputs, harmonics), harmonics,
                                    coefficient_std, direct (channels, inputs, harmonics), direct_harmonics, initial
                                    (modes, records); estimates/ and
                                    unselected/, the fit with its joint covariance: exponents, real (modes,),
                                    fundamental, modes, harmonics (terms,), coefficients, scales (terms, channels,
                                    hits), covariance, slopes (terms, channels, hits, parameters), spread (blocks,
                                    2 terms, 2 terms), blocks (channels, hits), drift, as spread, bend, as scales, and
                                    shared, where all hits have one shape; absent where there is none
    /validation/                    passed (1 or 0), findings, fit, held_out_error, colour (channels, hits), tones
                                    (channels, hits, tones) left at turns, lines (channels, hits, lines) left at
                                    harmonics of modes; metrics/, limits/ and failing/, of fit, held_out_error,
                                    held_out_stretch, period, tone, harmonic, line, colour, mode, multipliers,
                                    liouville, composition, misfit, remainder; at_least: those of the limits that
                                    are the least allowed; absent where nothing was validated
    /state/                         times, transition (times, n, n), system (times, n, n), condition, states,
                                    system_std, transition_std, coordinates (what the states are, in words), inputs,
                                    outputs, direct and inputs_std where inputs were measured, provenance/; absent
                                    when no A(t) was asked for
    /refinement/                    of an A(t) that was fitted with a structure: structure (a text), parameters, names,
                                    covariance, exponents, exponent_std (modes,), chi_square, degrees, p_value,
                                    findings; state/ where it is not that of the file; absent where no structure was
                                    asked for
    .../channels/                   name, quantity, unit, location, direction, place (frame, group, member, axis, angle:
                                    absent of files before there was one), each (channels,)
    .../provenance/                 sources, steps

Of free responses there is beside these::

    /decay/fit/                     noise (channels, hits), period_std, own_period (the difference and its deviation),
                                    constrained (1 where residues were constrained to their harmonics), misfit (what
                                    they then leave over the noise), whitening (channels, taps) where the noise was
                                    coloured, findings, warnings, later (the cycles of each hit behind those that were
                                    fitted: they told the noise) where there are such; forced/, the forced response,
                                    where there is one: harmonics of the revolution, coefficients, coefficient_std,
                                    offset, offset_std, drift, drift_std, revolution, speed_dependent; free/hit1, ...,
                                    what was fitted without it, each as in records/, where that is not the response that
                                    the records have
    /decay/modal/                   multipliers (modes,), residues (modes, outputs, inputs), dt, covariance,
                                    residue_spread, residue_slope, residual_std, outcome (a name), stats/
    /decay/choice/                  findings for and against the order, where it was found
    /decay/periodicity/             of a model whose periodicity was tested: statistic, degrees, p_value, level, power,
                                    spacing_p, harmonics, exponents (modes,), channels, sizes and limits (modes,
                                    harmonics), untested (cases, 2), locked; by_harmonic/, by_mode/ and by_channel/,
                                    each of statistics, degrees, p_values, adjusted (parts,)

The cycles and the lifted responses are not in the file: they are made of the free response again. Of records whose
excitation goes on there is instead::

    /driven/modes/mode1, mode2, .../    exponent, real (1 of a real one), turns (harmonics,), reach (harmonics of
                                        inputs,), gains; initial (records,) and sizes of measured inputs, shape
                                        (channels, harmonics) of random excitation
    /driven/direct                      of measured inputs: harmonics of the direct term
    /driven/columns, /driven/initial    of random excitation: coefficients of the known columns, first states (records,
                                        states)

The columns and the covariance of such a fit are made of its modes and records again.

Transfer functions measured line by line have the `kind` "measured", and modes fitted to them "fitted"::

    /transfer/, /measured/          frequencies_hz, harmonics, values and std (harmonics, outputs, inputs, frequencies),
                                    outputs/ and inputs/ as channels/, step (null of continuous time)
    /period, /method, /noise, /coherence, /nonlinear, /echoes, /begins    of `MeasuredTransfer`, beside /transfer/
    /model/, /covariance, /hold, /begins, /chi_square, /degrees           of `TransferFit`, beside /measured/
    /fit/modes/mode1, ...           as of measured inputs, with shape (outputs, harmonics)
    /fit/direct0, direct1, ...      the direct term at each harmonic (outputs, inputs)

What is found of several records has a `kind` too. A survey, "survey"::

    /over, /confidence, /notes, /warnings, /unlinked    the quantity, the probability of an interval of an edge,
                                    sentences, and modes on no track (point and mode)
    /shapes                         how shapes were read: JSON
    /points/point1, ...             values/, files, marks, passed, weak and names (modes,), reason, whirl (modes, 2),
                                    blades (modes, 4), whirl_interval and leak_interval (modes, 2); model/ of one hit
    /tracks/track1, ...             name, and over its places: points, modes (the second -1 of no couple), exponents,
                                    exponent_std, shifts, mirrored, weak, confidence, mac, cost, runner_up, whirl,
                                    whirl_std, names, name_share, leak, leak_std; whirl_interval and leak_interval
                                    (places, 2)
    /edges/edge1, ...               value, std, interval, between, kind, tracks, direction

a comparison, "comparison"::

    /a, /b, /over, /chi2, /dof, /p, /independent, /warnings, /missing_in_a, /missing_in_b   as of `Comparison`
    /points/point1, ...             value, model_a/ and model_b/ of one hit, modes_a, modes_b, macs, turn
    /pairs/pair1, ...               as of `Pair`

parameters that were fitted, "update"::

    /values/, /start/, /used/       names and numbers, each (parameters,); covariance (parameters, parameters)
    /chi2, /dof, /p, /steps, /is_converged, /warnings
    /unidentifiable/unidentifiable1, ...    weights/ (names and numbers), std
    /misfits/misfit1, ...           point, mode, frequency_hz, z

and monitored records, "monitor"::

    /files, /x, /baseline, /alarm, /reasons (records,), /over, /rate, /covariates, /conditions, /warnings
    /charts/, /amounts/, /change/   as of `Charts`, `Amounts` with trend/, and `Change`; absent where there is none
    /change/carried_by/carried_by1, ...     feature, unit, size, std

Files of earlier versions of the layout, which no release of floquid wrote, are refused.
"""

from floquid.store._files import load, save

__all__ = ["load", "save"]
