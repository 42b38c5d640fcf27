"""Terms of the reports in plain words, and where they occur in a text.

One place for all pages: headings of columns, key numbers, captions and sentences are searched for these terms, the
first one of a text is explained on hover, and the page ends with a list of all that it uses.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

TERMS: Mapping[str, str] = {
    "ESR": "error-to-signal ratio: sum of squared errors over the sum of squares of the measured output about its "
           "mean; 0 is perfect, 1 is no better than the mean",
    "fit": "100 (1 − √ESR) per cent: 100 % is perfect, 0 % is no better than the mean of the measured output",
    "rmse": "root mean square error: the size of the error, in the unit of the output",
    "mean error": "mean of measured minus simulated: an offset that the model lacks",
    "free run": "simulation: the model is fed with its own past outputs, the measured output is used only to start",
    "one-step": "prediction one sample ahead, from measured past outputs: easier than a free run, and no simulation",
    "held-out": "data that the fit has not seen: figures on them show how good the model is on other data",
    "training": "data that the model was fitted to: figures on them give little information on other data",
    "cross-validated": "evaluated in turn on stretches that each fit has not seen",
    "residual": "what a prediction one sample ahead leaves of the measured output",
    "whiteness": "no correlation of the residual with its own past: nothing is left that a model could predict",
    "autocorrelation": "correlation of a signal with itself at another time",
    "cross-correlation": "correlation of two signals, one of them at another time",
    "scheduling": "measured signals, such as a current, that the coefficients of the model depend on",
    "frozen": "with the scheduling variables held still at one value",
    "pole": "root of the characteristic equation: how fast the response decays, and whether it oscillates",
    "gamma": "largest factor by which the energy of a disturbance can reach the performance signals",
    "induced gain": "largest factor by which the energy of an input can reach the output, over all inputs and courses "
                    "of the scheduling",
    "verified gain": "largest factor by which the energy of a disturbance reaches the performance signals, as "
                     "certified for the closed loop itself and checked with numpy",
    "certificate": "matrices that prove a property for every course of the scheduling allowed; re-checked with numpy",
    "covariance": "how much estimated parameters would vary from one experiment to the next, and together",
    "standard error": "standard deviation of an estimated parameter from one experiment to the next",
    "condition number": "uncertainty of the least determined combination of parameters, as a multiple of that of the "
                        "best determined one",
    "BIC": "Bayesian information criterion: error of the fit plus a penalty for every parameter; less is better",
    "ΔBIC": "difference of the Bayesian information criterion: gain of fit by a cause beyond the penalty for its "
            "parameters",
    "p-value": "probability of a figure at least as large if there is no effect; a small one indicates an effect",
    "passivity": "giving back no more energy than was taken",
    "singular values": "gains of a system with several inputs and outputs at one frequency, from the largest to the "
                       "smallest",
    "sensitivity": "from a disturbance to the signal that control is to keep small; 1 is no control",
    "Pareto": "where no other choice is better in both respects at once",
    "clairvoyant bound": "what the best current for the known road reaches: no controller has that road in advance",
    "MTVV": "maximum transient vibration value of ISO 2631-1: largest running rms over one second",
    "W_k": "frequency weighting of ISO 2631-1 for vertical vibration of a seated person",
    "PSD": "power spectral density: how the mean square of a signal is spread over frequency",
    "noise floor": "error that repeats of the same experiment show: no model can do better",
    "extrapolation": "outside the range of the training data: the model was never compared with anything there",
    "likelihood ratio": "how much more probable the data are with a candidate than without it",
    "gas force": "static force of the pressurised gas on the rod",
    "hysteresis": "force that depends on where the motion came from: the loop over velocity has a width",
}
"""Explanation of every term. Where one contains another, the longer is found."""

_BY_LOWER = {term.lower(): term for term in TERMS}
_ALIASES = {"free-run": "free run", "free runs": "free run", "certificates": "certificate",
            "standard errors": "standard error", "std. error": "standard error", "poles": "pole",
            "residuals": "residual", "one step ahead": "one-step", "singular value": "singular values"}
_FIGURE = r"(?<=free-run )fit|fit(?= \[%\]| -?\d|, )"
"""The figure "fit", as a fit to data is something else."""
_FOUND = re.compile(r"(?<![\w/|^-])(" + "|".join([_FIGURE, *(
    re.escape(t) for t in sorted({*TERMS, *_ALIASES} - {"fit"}, key=len, reverse=True))]) + r")(?![\w|-])",
    re.IGNORECASE)


def term_of(text: str) -> str:
    """The term that a word or a whole cell is, or "".

    Parameters
    ----------
    text : str
        In any case, with plural or hyphen as in the aliases; spaces around it are dropped.

    Returns
    -------
    str
        A key of `TERMS`, or "".

    Examples
    --------
    >>> term_of("free-run"), term_of("esr"), term_of("other")
    ('free run', 'ESR', '')
    """
    word = text.strip().lower()
    return _BY_LOWER.get(_ALIASES.get(word, word).lower(), "")


def split_terms(text: str) -> list[tuple[str, str]]:
    """A text in pieces: (words, term or ""), each term marked once.

    Parameters
    ----------
    text : str
        A sentence, heading or caption.

    Returns
    -------
    list of (str, str)
        The pieces put together give the text; a term that comes again is left inside the plain text.

    Examples
    --------
    >>> split_terms("free-run ESR, held-out")
    [('free-run', 'free run'), (' ', ''), ('ESR', 'ESR'), (', ', ''), ('held-out', 'held-out')]
    """
    pieces: list[tuple[str, str]] = []
    seen: set[str] = set()
    end = 0
    for match in _FOUND.finditer(text):
        term = term_of(match.group())
        if not term or term in seen:
            continue
        seen.add(term)
        if match.start() > end:
            pieces.append((text[end:match.start()], ""))
        pieces.append((match.group(), term))
        end = match.end()
    if end < len(text):
        pieces.append((text[end:], ""))
    return pieces
