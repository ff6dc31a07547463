"""tltl: the robustness of the whole trace, paid at its end (Li, Vasile, Belta, IROS 2017)."""

from types import MappingProxyType

from stlbench_methods.progress import Followed


class Tltl(Followed):
    """The formula's robustness at the last transition of an episode, and 0 before it.

    The source has no discount, gamma = 1. Here that is the agent's, so an agent that discounts sees little of the
    reward early in an episode.

    The policy sees how far the formula is: the running maximum or minimum of each term. For F[a,c1] G[c2,b] psi that is
    the best window so far, and the last b - c2 + 1 margins. Formulas outside the fragment of eq. 2 have a memory
    likewise, see `stlbench_methods.progress`.

    Args:
        semantics: what stands for minimum and maximum; see `stlbench.stl.semantics`. All but `classic` divide each
            predicate by its largest size over the box of the signals.
        sharpness: of `lse` and `gilpin`.

    Raises:
        Unsuitable: an operator looks back, or a part of the formula has no bounds.
    """

    preference = MappingProxyType({"sum": 1})
