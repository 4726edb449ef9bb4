"""Intervals, tests and curves for results whose unit is the world, not the run.

Runs of one world are correlated (intra-class correlation 0.4 in published Gazebo
runs), so an interval that treats runs as independent is far too narrow. Here it comes
from the double bootstrap, see `hlsd.analysis.statistics.resampling`; that of a rate,
from the exact one of fewer runs, see `hlsd.analysis.statistics.rates`.
"""

from hlsd.analysis.statistics.betting import capital as capital
from hlsd.analysis.statistics.betting import confidence_sequence as confidence_sequence
from hlsd.analysis.statistics.betting import first_above as first_above
from hlsd.analysis.statistics.curves import CumulativeIncidence as CumulativeIncidence
from hlsd.analysis.statistics.curves import Profile as Profile
from hlsd.analysis.statistics.curves import Regression as Regression
from hlsd.analysis.statistics.curves import cumulative_incidence as cumulative_incidence
from hlsd.analysis.statistics.curves import performance_profile as performance_profile
from hlsd.analysis.statistics.curves import regression_band as regression_band
from hlsd.analysis.statistics.curves import regression_bands as regression_bands
from hlsd.analysis.statistics.intervals import Estimate as Estimate
from hlsd.analysis.statistics.intervals import estimate as estimate
from hlsd.analysis.statistics.intervals import world_interval as world_interval
from hlsd.analysis.statistics.intervals import world_intervals as world_intervals
from hlsd.analysis.statistics.orders import DIFFICULTY_ORDERS as DIFFICULTY_ORDERS
from hlsd.analysis.statistics.orders import ORDERS as ORDERS
from hlsd.analysis.statistics.orders import WorldOrder as WorldOrder
from hlsd.analysis.statistics.orders import order_worlds as order_worlds
from hlsd.analysis.statistics.paired import EQUIVALENCE_LEVEL as EQUIVALENCE_LEVEL
from hlsd.analysis.statistics.paired import Paired as Paired
from hlsd.analysis.statistics.paired import PairedMeans as PairedMeans
from hlsd.analysis.statistics.paired import RunValues as RunValues
from hlsd.analysis.statistics.paired import equivalent as equivalent
from hlsd.analysis.statistics.paired import holm as holm
from hlsd.analysis.statistics.paired import paired_difference as paired_difference
from hlsd.analysis.statistics.paired import paired_differences as paired_differences
from hlsd.analysis.statistics.paired import paired_means as paired_means
from hlsd.analysis.statistics.paired import wilcoxon_p as wilcoxon_p
from hlsd.analysis.statistics.rates import Rate as Rate
from hlsd.analysis.statistics.rates import difference_interval as difference_interval
from hlsd.analysis.statistics.rates import rate as rate
from hlsd.analysis.statistics.rates import rate_band as rate_band
from hlsd.analysis.statistics.rates import rate_interval as rate_interval
from hlsd.analysis.statistics.resampling import LEVEL as LEVEL
from hlsd.analysis.statistics.resampling import RESAMPLES as RESAMPLES
from hlsd.analysis.statistics.resampling import draw_worlds as draw_worlds
from hlsd.analysis.statistics.resampling import (
    percentile_interval as percentile_interval,
)
from hlsd.analysis.statistics.resampling import resampled_sums as resampled_sums
from hlsd.analysis.statistics.resampling import resamples_of as resamples_of
from hlsd.analysis.statistics.resampling import world_means as world_means
