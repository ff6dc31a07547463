"""Which of the tasks that come with stlbench are the paper's, which come from the field, which have no recipe, and
which are systems.
"""

from __future__ import annotations

from stlbench.registry import plugins

TASKS = sorted(name for name, plugin in plugins.available("tasks").items() if plugin.distribution == plugins.OWN)
FIELD = ("cartpole-steady", "dwell", "either-or", "hopper", "lane", "lunar-lander", "patrol", "walker")
WITHOUT_RECIPES = (
    *("ant-avoid", "ant-goals", "ant-patrol", "cheetah-band", "door", "fetch-avoid"),
    *("linear-chain", "panda-places", "quadrotor-gates", "quadrotor-patrol", "unicycle-choice", "walker-band", "zones"),
)
"""Tasks for which nobody made anything by hand but a controller."""
ON_ENVIRONMENTS = (
    *("ant-avoid", "ant-goals", "ant-patrol", "cheetah-band", "door", "hopper", "lane", "lunar-lander"),
    *("walker", "walker-band"),
)
SYSTEMS = [name for name in TASKS if name not in ON_ENVIRONMENTS]
PAPER = [name for name in TASKS if name not in (*FIELD, *WITHOUT_RECIPES)]
