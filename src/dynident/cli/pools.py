"""Where a command does its tasks: in this process, in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynident.workers.pool import Pool


def add_pool_option(group: argparse._ArgumentGroup) -> None:
    """Add the option that names a cluster."""
    group.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="in place of --jobs: a Dask cluster, such as tcp://host:8786, its JSON file, or local:N (docs/scale.md)",
    )


def cluster_of(options: argparse.Namespace) -> Pool | None:
    """Return the cluster that the options name; None where they name none.

    Raises:
        BadOption: It stands beside --jobs, or is no scheduler.
    """
    if options.scheduler is None:
        return None
    from dynident.errors import BadOption
    from dynident.workers.dask_pool import DaskPool

    if options.jobs != 1:
        raise BadOption("--jobs", options.jobs, "it does not go with --scheduler; give one of the two")
    return DaskPool(options.scheduler)
