"""A researcher's morning with fbgraph, from Python: read, smooth, compare, plot, a folder of walks, online.

.venv/bin/python scripts/example.py; the same cells are in scripts/example.ipynb.
"""

# %% [markdown]
# # A morning with fbgraph
# Where somebody walked, from accelerometer, gyroscope, magnetometer and barometer alone. No log of your own is needed
# here: these walks are simulated, with everything that goes wrong in a cheap wearable.

# %%
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import fbgraph

folder = Path(mkdtemp(prefix="fbgraph-example-"))

# %% [markdown]
# ## Read and smooth
# `fbgraph.read_log("walk.csv")` reads a file of yours; a DataFrame with columns such as `t_s`, `acc_x_ms2`,
# `gyro_z_rads` does as well. Truth only scores.

# %%
simulated = fbgraph.simulate("obstacle", seed=3)
walk = fbgraph.smooth(simulated.log, truth=simulated.checkpoints, config="m5stickc")
print(walk)

# %% [markdown]
# ## Compare
# Every estimator worked on the same steps.

# %%
scores = pd.DataFrame(walk.scores).T[["rmse_m", "mean_m", "max_m", "final_m"]]
print(scores)
for finding in walk.findings:
    print(f"{finding.start_s:6.1f} s  {finding.text}")

# %% [markdown]
# ## Plot
# Breadcrumbs with their uncertainty are a table.

# %%
table = walk.trajectories["smoothed"].to_dataframe()
figure, axes = plt.subplots(figsize=(5, 4))
for name, trajectory in walk.trajectories.items():
    axes.plot(trajectory.x_m, trajectory.y_m, label=name)
axes.plot(simulated.checkpoints.x_m, simulated.checkpoints.y_m, "k+", label="truth")
last = table.iloc[-1]
angle = np.linspace(0.0, 2.0 * np.pi, 50)
along, across = 2.0 * last.ellipse_major_m * np.cos(angle), 2.0 * last.ellipse_minor_m * np.sin(angle)
cos, sin = np.cos(last.ellipse_yaw_rad), np.sin(last.ellipse_yaw_rad)
axes.plot(last.x_m + cos * along - sin * across, last.y_m + sin * along + cos * across, "0.5", label="2σ at the end")
axes.set(xlabel="East [m]", ylabel="North [m]", aspect="equal")
axes.legend()
figure.savefig(folder / "walk.png")

# %% [markdown]
# ## Keep
# The run folder is the one that `fbgraph smooth` writes; `fbgraph view`, `fbgraph guide` and `load_run` read it.

# %%
walk.save(folder / "run", recording=False)
again = fbgraph.load_run(folder / "run")
print(again)

# %% [markdown]
# ## A folder of walks

# %%
rows = []
for seed in range(4):
    one = fbgraph.simulate("square", seed=seed)
    smoothed = fbgraph.smooth(one.log, truth=one.checkpoints, config="m5stickc")
    rows.append({name: score["rmse_m"] for name, score in smoothed.scores.items()})
print(pd.DataFrame(rows).describe().loc[["mean", "max"]])

# %% [markdown]
# ## While walking
# The same steps and the same graph, solved as samples arrive.

# %%
online = fbgraph.OnlineSmoother("m5stickc")
for start_s in np.arange(0.0, simulated.log.duration_s + 1.0, 1.0):
    for update in online.feed(simulated.log.between(start_s, start_s + 1.0)):
        if update.k % 20 == 0:
            print(f"{update.t_s:6.1f} s  {update.x_m:6.2f} m East  {update.y_m:6.2f} m North")
finished = online.finish()
apart_m = np.abs(finished.trajectories["smoothed"].xy_m - walk.trajectories["smoothed"].xy_m).max()
print(f"{finished}; {apart_m:.6f} m from the batch smoother")
