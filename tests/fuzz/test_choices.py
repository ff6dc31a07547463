"""Any words in the place of names, parameters and seeds on the command line."""

from __future__ import annotations

from fuzz.answers import answer, fuzz, sizes
from fuzz.inputs import soup
from hypothesis import strategies as st

NAMED = "toy-raw toy-line toy-agent toy-large toy-wrong toy-broken funnel hold-disc ./x / .."
VALUED = "1 -1 1e999 nan 2.5 x true 1_0 0x1 a+b ² ٣"
WORDS = "weight action without cuts weight=2 action=1 [ ] [ ] , = [weight=1] [action=0] [weight= ]] é"
NAMES, VALUES = NAMED.split(), [*VALUED.split(), "9" * 400, ""]
PIECES = [*NAMES, *VALUES, *WORDS.split(), " ", "\n", "\x00", "\x1b", "\udcff"]
CHOICES = st.one_of(
    soup(PIECES, 8),
    st.builds("{}[{}={}]".format, st.sampled_from(NAMES), st.sampled_from(PIECES), st.sampled_from(VALUES)),
)
SEEDS = st.one_of(
    soup([*VALUES, "0", "3", "10", "99999", "-", ",", "0-4", "3,7", "5-1", " ", "--", "1e3", "+2"], 6),
    st.text(max_size=8),
)
RUN = ("run", "--executor", "toy-here", "--budget", "quick")


@sizes(15, 3_500)
def test_names_and_parameters_are_known_or_refused(brief, examples):
    def check(words: tuple[str, str, str]) -> None:
        task, method, agent = words
        answer(brief(*RUN, f"--tasks={task}", f"--methods={method}", f"--agents={agent}", "--seeds", 1))

    good = st.sampled_from
    fuzz(
        examples,
        st.one_of(
            st.tuples(CHOICES, good(["toy-raw"]), good(["toy-agent"])),
            st.tuples(good(["toy-line"]), CHOICES, good(["toy-agent"])),
            st.tuples(good(["toy-line"]), good(["toy-raw"]), CHOICES),
            st.tuples(CHOICES, CHOICES, CHOICES),
        ),
        check,
    )


@sizes(20, 3_500)
def test_seeds_are_read_or_refused(brief, examples):
    """With a method that fits no task, so that ten thousand cells would be nothing to wait for."""

    def check(seeds: str) -> None:
        words = ("--tasks", "toy-line", "--methods", "no-such", "--agents", "toy-agent", f"--seeds={seeds}")
        assert not answer(brief(*RUN, *words))

    fuzz(examples, SEEDS, check)


OPTIONS = {
    "--jobs": ["0", "-1", "1e9", "x", "", "9" * 400],
    "--memory": ["", "4", "4X", "-4G", "1e3G", "9" * 400 + "G", "4G", "0.0000001K", "٣G"],
    "--budget": ["", "no", "\x1b", "quick "],
    "--track": ["", "plain", "tuned", "x"],
    "--results": ["", "/dev/null", "/dev/null/x", "study.yaml/x", "x" * 300, "a\x00b", "\udcff"],
    "--recipes": ["", "/", "/dev/null", "no-such"],
    "--executor": ["", "local[jobs=0]", "local[memory=1]", "no-such", "toy-here[x=1]", "[", "\udcff"],
}
TEXTS = st.text(st.characters(exclude_categories=["C"]), max_size=5)
ONE_OPTION = st.sampled_from(sorted(OPTIONS)).flatmap(
    lambda name: st.tuples(st.just(name), st.one_of(st.sampled_from(OPTIONS[name]), TEXTS))
)


@sizes(20, 3_000)
def test_options_are_read_or_refused(brief, examples):
    def check(option: tuple[str, str]) -> None:
        name, value = option
        executor = () if name == "--executor" else ("--executor", "toy-here")
        words = ("--tasks", "toy-line", "--methods", "toy-raw", "--agents", "toy-agent", "--seeds", 1)
        answer(brief("run", *words, *executor, f"{name}={value}"))

    fuzz(examples, ONE_OPTION, check)
