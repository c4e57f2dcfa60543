"""What mypy finds in a user's script: an `ignore` that hides no error is an error itself (`warn_unused_ignores`)."""

from insenv.envs import AlignmentEnv, AlignmentVectorEnv


def right() -> None:
    AlignmentEnv("ship-swaying", samples_per_step=3, heading_deg=(0.0, 90.0))
    AlignmentVectorEnv(2, samples_per_step=3, threads=2)


def wrong() -> None:
    AlignmentEnv(samples_per_stepp=3)  # type: ignore[call-arg]
    AlignmentVectorEnv(2, samples_per_stepp=3)  # type: ignore[call-arg]
    AlignmentEnv(duration_s="60")  # type: ignore[arg-type]
