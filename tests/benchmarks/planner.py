"""How long a person in the browser waits for the planner: for the face to follow, the prediction, finite elements.

python tests/benchmarks/planner.py "http://127.0.0.1:8050/?secret=..." [--times 40]

The planner is already open, on a patient with a cut mandible, at the address that `make planner` printed. Headless
Chromium moves the mandible by 0.1 mm to and fro and takes the time in the page, from the key to the picture of the
first look and to that of the prediction. Then it wishes the chin elsewhere and takes the time from the click to the
words of the plan that finite elements have verified; the first wish, which prepares them, by itself. Prints median,
95th percentile and longest of each in ms.
"""

import argparse
import shutil
from statistics import median, quantiles

from playwright.sync_api import Page, sync_playwright

READY = 120_000  # ms
REST = 1000  # ms in which nothing is asked
MEASURE, NEAREST, STEP = "pog_forward", 1.0, 0.1  # the wish: so many mm farther forward, each time a step more
# What comes of a key: the words about the plan, and the pictures, which follow their words. What comes of a wish: the
# words of finite elements, once others have taken the place of those of the wish before.
WATCH = """() => {
  const words = document.querySelector('#about_A'), predicted = () => /volume ratio/.test(words.innerText);
  const verified = () => /^Finite elements/.test(document.querySelector('#said')?.innerText.trim());
  window.pictures = [];
  document.addEventListener('keydown', () => { window.pressed = performance.now(); window.pictures = [] }, true);
  document.querySelector('main img').addEventListener('load', () =>
    window.pictures.push([performance.now() - window.pressed, predicted()]));
  document.addEventListener('click', (event) => {
    if (event.target.closest('#fit')) Object.assign(window, {asked: performance.now(), sought: false, verified: null});
  }, true);
  new MutationObserver(() => {
    window.sought ||= !verified();
    if (window.sought && verified()) window.verified ??= performance.now() - window.asked;
  }).observe(document.body, {subtree: true, childList: true, characterData: true});
}"""


def follow(page: Page, times: int) -> dict[str, list[float]]:
    """Milliseconds of `times` keys until the face follows and until the prediction is seen."""
    waits = {"face follows": [], "prediction": []}
    page.click("#segment_mandible_distal")
    page.wait_for_timeout(REST)
    slider = page.locator(".v-slider [role=slider]").nth(0)
    for key in range(times):
        slider.press("ArrowLeft" if key % 2 else "ArrowRight")
        page.wait_for_function("window.pictures.some(([_, predicted]) => predicted)")
        page.wait_for_timeout(REST)
        pictures = page.evaluate("window.pictures")
        first = [ms for ms, predicted in pictures if not predicted]
        last = [ms for ms, predicted in pictures if predicted]
        if not first:
            raise SystemExit(f"key {key + 1}: no first look came, but {pictures}")
        waits["face follows"].append(first[0])
        waits["prediction"].append(last[-1])
    return waits


def verify(page: Page, times: int) -> list[float]:
    """Milliseconds of one wish and `times` further ones until finite elements have verified the plan."""
    field, waits = page.locator(f"#wish_{MEASURE}"), []
    before = float(page.locator("#measures tr", has=field).locator("td").nth(1).inner_text().replace("−", "-"))
    for wish in range(1 + times):
        field.fill(f"{before + NEAREST + STEP * wish:.1f}")
        field.press("Enter")
        page.wait_for_timeout(REST)
        page.click("#fit")
        page.wait_for_function("window.verified || /^Not done/.test(document.querySelector('#said')?.innerText.trim())")
        if not (waited := page.evaluate("window.verified")):
            raise SystemExit(f"wish {wish + 1}: {page.inner_text('#said')}")
        waits.append(waited)
        page.wait_for_timeout(2 * REST)  # the face follows the plan
    return waits


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("address")
    parser.add_argument("--times", type=int, default=40, help="keys, and wishes")
    asked = parser.parse_args()
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.set_default_timeout(READY)
        page.goto(asked.address)
        page.locator("#about_A").get_by_text("smallest volume ratio").wait_for()
        page.locator("main img").wait_for(state="attached")
        page.evaluate(WATCH)
        waits = follow(page, asked.times)
        first, *waits["verified by finite elements"] = verify(page, asked.times)
        browser.close()
    for what, times in waits.items():
        late = quantiles(times, n=20, method="inclusive")[-1]
        print(f"{what}: median {median(times):.0f}, p95 {late:.0f}, longest {max(times):.0f} ms, {len(times)} times")
    print(f"the first wish: {first:.0f} ms")


if __name__ == "__main__":
    main()
