"""Claims about `softclose sign`: the interval decides, the sheet names what it rests on, and fits one page."""

from __future__ import annotations

import hashlib
import json
import math
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, seed
from hypothesis import strategies as st

from reported import HOSTILE, chromium
from small_campaigns import COARSE, make_campaign
from softclose.evaluate import respond
from softclose.evaluate.quantities import QUANTITIES, Closing, Value, quantity
from softclose_workflows.analyses.certify import certify, fresh_switches
from softclose_workflows.analyses.signing import (
    ASK_IMPACTS,
    SHOWN,
    Sheet,
    SignError,
    parsed_limits,
    sheet_to_json,
    sign,
    verdict_of,
)
from softclose_workflows.cli import main
from softclose_workflows.report.sign_page import judged, render_sign

N = 400


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    name = f"campaign.name={HOSTILE}"
    path = make_campaign(tmp_path_factory.mktemp("sign") / "a.zarr", *COARSE, name)
    certify(path, n_switches=N, top=2)
    return path


@seed(39)
@given(
    low=st.floats(-50.0, 50.0),
    width=st.floats(0.0, 20.0),
    limit=st.floats(-80.0, 80.0),
    better=st.sampled_from(["v_u", "hold_margin"]),
)
def test_the_whole_interval_decides(low: float, width: float, limit: float, better: str) -> None:
    q = quantity(better)
    value = Value(estimate=low + 0.5 * width, interval=(low, low + width), n=100)
    found = verdict_of(q, value, limit)
    keeps = [end <= limit if q.better == "low" else end >= limit for end in value.interval]
    assert found == ("pass" if all(keeps) else "not established" if any(keeps) else "fail")
    assert verdict_of(q, value, None) == "not judged"


def test_what_is_not_known_is_never_passed() -> None:
    nothing = Value(estimate=math.nan, interval=(math.nan, math.nan), n=0)
    assert {verdict_of(q, nothing, 1.0) for q in QUANTITIES.values()} == {"not established"}


def test_values_are_those_of_the_certificate_s_switches_simulated_afresh(store: str) -> None:
    sheet = sign(store, {"release_force": 1.0, "cvar": 1.0})
    assert [line.quantity.name for line in sheet.lines] == [*SHOWN, "release_force", "cvar"]
    lot = fresh_switches(sheet.config, N, seed=sheet.certification.seed)
    closing = Closing.of(sheet.config, lot, sheet.best.waveform, respond(sheet.config, lot, sheet.best.waveform))
    for line in sheet.lines:
        expected = line.quantity.of(closing)
        np.testing.assert_allclose(line.value.estimate, expected.estimate, rtol=1e-12)
        np.testing.assert_allclose(line.value.interval, expected.interval, rtol=1e-12)


def limits_around(sheet: Sheet, *, kept: bool) -> list[str]:
    texts = []
    for line in sheet.lines:
        if not math.isfinite(line.value.estimate):  # too many stay open to have a closing time
            continue
        side = 1.0 if (line.quantity.better == "low") == kept else -1.0
        texts += ["--limit", f"{line.quantity.name}={line.value.estimate + side * 1e3!r}"]
    return texts


def test_verdicts_exit_codes_and_pages(store: str, tmp_path: Path) -> None:
    page = str(tmp_path / "a.html")
    sheet = sign(store, {})
    cases = {
        ("pass", 0): limits_around(sheet, kept=True),
        ("fail", 4): limits_around(sheet, kept=False),
        ("not established", 4): ["--limit", f"v_u={sheet.best.assessment.v_u_cm_s!r}"],
        ("not judged", 0): [],
    }
    for (verdict, code), limits in cases.items():
        done = CliRunner().invoke(main, ["sign", store, *limits, "-o", page])
        assert (done.exit_code, done.output.splitlines()[0]) == (code, f"verdict: {verdict}"), done.output
        told = CliRunner().invoke(main, ["sign", store, *limits, "--json"])
        assert (told.exit_code, json.loads(told.output)["verdict"]) == (code, verdict)
    one_fails = CliRunner().invoke(
        main, ["sign", store, *limits_around(sheet, kept=True), "--limit", "peak=1", "-o", page]
    )
    assert (one_fails.exit_code, one_fails.output.splitlines()[0]) == (4, "verdict: fail")


def test_the_sheet_names_everything_that_the_verdict_rests_on(store: str) -> None:
    sheet = sign(store, parsed_limits(["v_u=90"]))
    found = sheet_to_json(sheet)
    assert hashlib.sha256(json.dumps(found["waveform"]).encode()).hexdigest() == found["waveform_sha256"]
    page = render_sign(sheet)
    for said in (
        found["waveform_sha256"],
        sheet.fingerprint,
        sheet.date,
        f"Candidate {sheet.best.candidate} on {N} new simulated switches",
        "at most 90.00 cm/s",
        *found["assumptions"],
    ):
        assert str(said) in page, said
    assert "<script" not in page
    assert {"numpy", "softclose", "softclose (this page)"} <= set(found["versions"])


def test_another_waveform_has_another_hash(store: str) -> None:
    c = sign(store, {}).certification
    from softclose_workflows.analyses.signing import waveform_digest

    assert len({waveform_digest(d.waveform) for d in (*c.candidates, *c.references)}) == len(c.candidates) + len(
        c.references
    )


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (["v_u"], "NAME=NUMBER"),
        (["v_u=fast"], "NAME=NUMBER"),
        (["v_u=nan"], "NAME=NUMBER"),
        (["=3"], "has no limit here"),
        (["vu=3"], "did you mean 'v_u'"),
        (["peak=5%"], "is in V"),
        (["impacts=20%"], "impacts is a number"),
        *[([f"{name}=3"], "has no limit here") for name in ASK_IMPACTS],
    ],
)
def test_a_limit_that_cannot_be_is_refused_in_one_line(texts: list[str], said: str) -> None:
    with pytest.raises(SignError, match=re.escape(said)) as e:
        parsed_limits(texts)
    assert "\n" not in str(e.value)


def test_limits_come_from_a_file_too_and_flags_win(store: str, tmp_path: Path) -> None:
    file = tmp_path / "limits.toml"
    file.write_text("v_u = 90\np_nc = 1.0\n")
    done = CliRunner().invoke(main, ["sign", store, "--limits", str(file), "--limit", "v_u=1", "--json"])
    told = {line["quantity"]: (line["limit"], line["verdict"]) for line in json.loads(done.output)["limits"]}
    assert told["v_u"] == (1.0, "fail")
    assert told["p_nc"] == (1.0, "pass")
    assert parsed_limits(["p_nc=5%"]) == parsed_limits(["p_nc=0.05"]) == {"p_nc": 0.05}


def test_without_a_certificate_nothing_is_signed(store: str, tmp_path: Path) -> None:
    bare = make_campaign(tmp_path / "bare.zarr", *COARSE)
    done = CliRunner().invoke(main, ["sign", bare, "-o", str(tmp_path / "a.html")])
    assert done.exit_code == 2
    assert "softclose certify" in done.output
    assert not (tmp_path / "a.html").exists()


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({}, "No limits were given: nothing is judged"),
        ({"v_u": 1e3}, f"The one limit given is met; {len(SHOWN) - 1} of the {len(SHOWN)} quantities below"),
        ({"v_u": 1e3, "peak": 1e3}, f"All 2 limits given are met; {len(SHOWN) - 2} of the {len(SHOWN)} quantities"),
        ({"v_u": 1e3, "peak": 1.0}, f"1 of the 2 limits given is missed; {len(SHOWN) - 2} of"),
    ],
)
def test_the_verdict_says_how_many_limits_it_rests_on(store: str, limits: dict[str, float], said: str) -> None:
    """One limit met, of ten quantities shown, is not "all limits"."""
    assert said in judged(sign(store, limits))


def test_a_limit_on_every_quantity_leaves_none_without(store: str) -> None:
    sheet = sign(store, {name: 1e6 if QUANTITIES[name].better == "low" else -1e6 for name in SHOWN})
    assert f"{len(SHOWN)} limits given " in judged(sheet)
    assert "have no limit" not in judged(sheet)


def test_the_sheet_warns_where_the_waveform_hardly_holds(store: str, tmp_path: Path) -> None:
    well = sign(store, {})
    best = well.holds[0]
    needs = replace(best, least_V=-8.5, held_V=74.0, n_short=7)
    weak = replace(well, holds=(needs, *well.holds[1:]))
    said = f"holds with 74.00 V, and 7 of {N} switches need more to stay closed, the worst 8.50 V more"
    assert said in render_sign(weak)
    assert said in sheet_to_json(weak)["hold_warning"]
    assert sheet_to_json(weak)["hold"][0]["least_V"] == -8.5
    strong = replace(well, holds=(replace(best, least_V=0.5 * best.held_V), *well.holds[1:]))
    assert "to stay closed" not in render_sign(strong)
    assert sheet_to_json(strong)["hold_warning"] is None
    # The sheet's own holds are those of the certificate's switches.
    told = CliRunner().invoke(main, ["certify", store, "--switches", str(N), "--top", "2", "--json"])
    assert json.loads(told.output)["hold"][0]["least_V"] == pytest.approx(best.least_V)


def test_how_many_impacts_there_are_is_no_share_of_anything(store: str) -> None:
    """Fifteen impacts were printed as 1500.00 % (1500.00–100.00 %)."""
    sheet = sign(store, {})
    line = next(line for line in sheet.lines if line.quantity.name == "impacts")
    low, high = line.value.interval
    assert f'>{line.value.estimate:.0f}</td><td class="n">{low:.0f}–{high:.0f}</td>' in render_sign(sheet)


@pytest.mark.skipif(chromium() is None, reason="needs chromium, which is not installed")
def test_it_is_one_page_of_paper(store: str, tmp_path: Path) -> None:
    page, pdf = tmp_path / "a.html", tmp_path / "a.pdf"
    every = [f"{name}=1" for name in QUANTITIES if name not in ASK_IMPACTS]
    page.write_text(render_sign(sign(store, parsed_limits(every))), encoding="utf-8")
    arguments = ["--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer", f"--print-to-pdf={pdf}"]
    subprocess.run(
        [str(chromium()), *arguments, f"--user-data-dir={tmp_path / 'p'}", page.as_uri()],
        capture_output=True, timeout=120, check=True,
    )  # fmt: skip
    assert len(re.findall(rb"/Type\s*/Page\b", pdf.read_bytes())) == 1


def test_the_sheet_says_what_a_drive_that_is_a_little_off_does(store: str) -> None:
    sheet = sign(store, {})
    told, text = sheet_to_json(sheet)["drive_off"], render_sign(sheet)
    assert [row["gain"] for row in told] == [-0.03, -0.01, 0.0, 0.01, 0.03]
    for row, kept in zip(told, sheet.certification.drive_off, strict=True):
        assert row["v_u_cm_s"] == kept.assessment.v_u_cm_s
        assert f"{kept.assessment.v_u_cm_s:.2f} cm/s" in text
    assert f"on all {N} new switches" in text
    assert "Volts +1 % is also what happens if the device model’s pull-in voltages are 1 % too high" in text


def test_the_sheet_says_how_open_switches_split_and_what_an_interval_is_not(store: str) -> None:
    sheet = sign(store, {})
    kinds = sheet_to_json(sheet)["open"]
    assert kinds["n_open"] == sheet.best.assessment.n - sheet.best.assessment.n_closed
    assert kinds["never_touch"] + kinds["not_held"] + kinds["not_integrated"] == kinds["n_open"] > 0
    text = render_sign(sheet)
    assert f"{kinds['n_open']} of {N} switches stay open: " in text
    assert "no error of the device model, and no lot that is distributed otherwise than assumed" in text


def test_an_older_certificate_is_signed_without_what_it_does_not_tell(
    store: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    certification = sign(store, {}).certification
    best = certification.best
    silent = replace(best, contacts={}, response=replace(best.response, first_contact_us=None, n_impacts=None))
    older = replace(certification, candidates=(silent, *certification.candidates[1:]), drive_off=())
    monkeypatch.setattr("softclose_workflows.analyses.signing.read_certification", lambda path: older)
    sheet = sign(store, {})
    assert [line.quantity.name for line in sheet.lines] == [n for n in SHOWN if n not in ("contact_time", "impacts")]
    assert "are a little off" not in render_sign(sheet)
    with pytest.raises(SignError, match=r"impacts cannot be told from a certificate: .*certify again"):
        sign(store, {"impacts": 20.0})
