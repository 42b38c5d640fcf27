"""How good a model is: free run and one step, training or held-out, where it is wrong, and what its residuals hold."""

from lpvid.validation.figures import FigurePair, Figures, RecordFigures
from lpvid.validation.regimes import Regime
from lpvid.validation.report import acting_model, figures, validate
from lpvid.validation.residuals import LAGS, ResidualTest, residual_tests
from lpvid.validation.result import Validation

__all__ = ["LAGS", "FigurePair", "Figures", "RecordFigures", "Regime", "ResidualTest", "Validation", "acting_model",
           "figures", "residual_tests", "validate"]
