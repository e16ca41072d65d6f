"""``paperrepro simulate``: a survey of the simulated farm, in the files that an operator has."""

import argparse
from pathlib import Path


def add(commands) -> None:
    from data_synth.operator import HEIGHT_M, LATITUDE_DEG, LONGITUDE_DEG

    command = commands.add_parser(
        "simulate",
        help="write a simulated survey as an operator has it: LAZ, SBET, mounting, truth",
    )
    command.add_argument("--out", type=Path, required=True, help="folder to write into")
    command.add_argument(
        "--preset", default="mount", help="true boresight: mount (default) or table4"
    )
    command.add_argument("--profile", default="quick", help="quick (default) or paper")
    command.add_argument("--scene", default="farm", help="farm (default) or forest")
    command.add_argument("--seed", type=int, default=1, help="of the survey (default 1)")
    command.add_argument(
        "--noise-scale", type=float, default=1.0, help="multiplies the GNSS/INS error (default 1)"
    )
    command.add_argument(
        "--latitude", type=float, default=LATITUDE_DEG, metavar="DEG",
        help=f"of the farm, south negative (default {LATITUDE_DEG}: the paper's site)",
    )  # fmt: skip
    command.add_argument(
        "--longitude", type=float, default=LONGITUDE_DEG, metavar="DEG",
        help=f"of the farm, west negative (default {LONGITUDE_DEG})",
    )  # fmt: skip
    command.add_argument(
        "--height", type=float, default=HEIGHT_M, metavar="M",
        help=f"ellipsoidal (default {HEIGHT_M:g})",
    )  # fmt: skip
    command.add_argument("--zone", type=int, help="of UTM (default: the site's own)")
    command.add_argument(
        "--scale", type=float, default=1e-4, metavar="M",
        help="resolution of the LAZ coordinates (default 0.0001)",
    )  # fmt: skip
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    from data_synth import make_config, simulate
    from data_synth.operator import Site, write_survey
    from paperrepro._cache import cached
    from paperrepro._files import written_whole

    config = make_config(
        options.preset, options.profile, seed=options.seed,
        noise_scale=options.noise_scale, scene=options.scene,
    )  # fmt: skip
    site = Site(options.latitude, options.longitude, options.height, options.zone)
    survey, truth = cached(simulate, config)
    with written_whole(options.out) as folder:
        write_survey(folder, survey, truth, site, options.scale)
    points = sum(len(strip) for strip in survey.strips)
    print(f"{options.out}: {len(survey.strips)} strips, {points} points, EPSG:{site.epsg}")
    return 0
