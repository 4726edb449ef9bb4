"""Episodes -> tables, figures, report.

The summary that `hlsd bench` prints is in `hlsd.report.summary`; `hlsd report` is
`hlsd.report.write.write_report`.
"""

from hlsd.analysis.runs import join_runs as join_runs
from hlsd.analysis.runs import load_episodes as load_episodes
from hlsd.analysis.runs import times_s as times_s
from hlsd.report.drawing import COLOURS as COLOURS
from hlsd.report.drawing import save_figure as save_figure
from hlsd.report.summary import PLOT as PLOT
from hlsd.report.summary import SUMMARY as SUMMARY
from hlsd.report.summary import plot_times as plot_times
from hlsd.report.summary import summarise as summarise
from hlsd.report.summary import summary_markdown as summary_markdown
from hlsd.report.summary import write_summary as write_summary
