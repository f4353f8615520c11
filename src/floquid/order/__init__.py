"""Order selection: models over a range of orders, the poles that stay, and what can be seen before any model.

`scan` takes `TimeResponses` and gives an `OrderScan`; `indicators` needs no model; `choose` finds the order and says
why. Knows nothing of channels and periods, as `lti`.
"""

from floquid.order._choose import Choice, choose, judge, judge_products
from floquid.order._scan import scan, stability
from floquid.order._types import Criteria, Indicators, OrderScan, Stability, Tolerances, indicators

__all__ = [
    "Choice", "Criteria", "Indicators", "OrderScan", "Stability", "Tolerances", "choose", "indicators", "judge", "scan",
    "stability",
]  # fmt: skip
