"""What a user can do wrong."""

from collections.abc import Iterable
from difflib import get_close_matches


class UserError(Exception):
    """A mistake of the user's: one line on stderr and exit code 2, no traceback."""


def unknown(kind: str, name: str, known: Iterable[str]) -> UserError:
    """The error for a name that is not there, with the nearest of those that are."""
    names = list(dict.fromkeys(known))
    # Case is the most frequent slip; get_close_matches alone finds t1 far from T1.
    folded = {n.lower(): n for n in names}
    near = [folded[n] for n in get_close_matches(name.lower(), folded, n=5, cutoff=0.5)]
    if near:
        hint = f"did you mean {', '.join(near)}?"
    elif len(names) <= 20:
        hint = f"there are {', '.join(names) or 'none'}"
    else:
        hint = f"there are {', '.join(names[:20])} and {len(names) - 20} more"
    return UserError(f"no {kind} is called '{name}': {hint}")
