"""Train a policy with Stable-Baselines3, or go on with a run: see --help."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from activeloc.cli.settings import NAMESPACE, parse_settings
from activeloc.errors import ActiveLocError

EXAMPLES = """examples:
  python train.py --env Maze7-v0 --total-timesteps 1000000 --out runs/maze7
  python train.py --env Maze15-v0 --imitate lookahead --total-timesteps 300000 --out runs/maze15
  python train.py --env GlobalLocalization-v0 --imitate glance --out runs/offices
  python train.py --env GlobalLocalization-v0 --imitate glance \\
      --set env.map=building.yaml --out runs/building
  tensorboard --logdir runs

The same command with --resume goes on where a run was stopped, and ends with the same weights.
`activeloc export runs/maze7 --out maze7.onnx` makes a file that `activeloc evaluate` can play.
"""


def parse_args(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """Command line to options; ``argv`` is for tests."""
    parser = argparse.ArgumentParser(
        prog="train.py",
        description=__doc__,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--env", required=True, metavar="ID", help="registered id")
    parser.add_argument("--algo", default="ppo", help="ppo (default), recurrent_ppo or dqn")
    parser.add_argument(
        "--total-timesteps", type=int, default=1_000_000, metavar="N", help="default: 1000000"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="same seed, same weights")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    parser.add_argument("--imitate", metavar="AGENT", help="learn first what this agent does")
    parser.add_argument("--resume", action="store_true", help="go on with the run in DIR")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="settings",
        help="a hyperparameter, env.SETTING of the environment or imitation.SETTING; repeatable",
    )
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code, those of `activeloc`."""
    args = parse_args(argv)
    # Here, so that --help is quick.
    from activeloc.agents.sb3.configuration import TrainingConfig
    from activeloc.agents.sb3.training import Stopped, train

    try:
        config = TrainingConfig.build(
            args.env if args.env.startswith(NAMESPACE) else NAMESPACE + args.env,
            args.algo,
            parse_settings(args.settings),
            total_timesteps=args.total_timesteps,
            seed=args.seed,
            imitate=args.imitate,
        )
        path = train(config, args.out, resume=args.resume, progress_bar=sys.stderr.isatty())
    except Stopped as stopped:
        print(f"train.py: {stopped}", file=sys.stderr)
        return stopped.exit_code
    except ActiveLocError as error:
        print(f"train.py: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"train.py: {error.filename or args.out}: {error.strerror or error}", file=sys.stderr)
        return 1
    print(f"{path}: trained for {args.total_timesteps} steps")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
