"""From a key on a slider of the planner to the pictures that answer it, as a person in the browser waits for them.

python tests/benchmarks/planner.py "http://127.0.0.1:8050/?secret=..." [--keys 16]

The planner is already open at the address that `make planner` printed. Headless Chromium moves the mandible by 0.1 mm
to and fro and takes the time in the page, from the key to the picture of the first look and to that of the prediction.
Prints median, 95th percentile and longest of each in ms.
"""

import argparse
import shutil
from statistics import median, quantiles

from playwright.sync_api import sync_playwright

READY = 120_000  # ms
ANSWERED = 2500  # ms, longer than any answer
# What comes of a key: the words about the plan, and the pictures, which follow their words.
WATCH = """() => {
  const words = document.querySelector('#about_A'), said = () => /volume ratio/.test(words.innerText);
  window.pictures = [];
  document.addEventListener('keydown', () => { window.pressed = performance.now(); window.pictures = [] }, true);
  document.querySelector('main img').addEventListener('load', () =>
    window.pictures.push([performance.now() - window.pressed, said()]));
}"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("address")
    parser.add_argument("--keys", type=int, default=16)
    asked = parser.parse_args()
    waits = {"first look": [], "prediction": []}
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1360, "height": 860})
        page.goto(asked.address)
        page.locator("#about_A").get_by_text("smallest volume ratio").wait_for(timeout=READY)
        page.click("#segment_mandible_distal")
        page.wait_for_timeout(ANSWERED)
        page.evaluate(WATCH)
        slider = page.locator(".v-slider [role=slider]").nth(0)
        for key in range(asked.keys):
            slider.press("ArrowLeft" if key % 2 else "ArrowRight")
            page.wait_for_timeout(ANSWERED)
            pictures = page.evaluate("window.pictures")
            first = [ms for ms, predicted in pictures if not predicted]
            last = [ms for ms, predicted in pictures if predicted]
            if not first or not last:
                raise SystemExit(f"key {key + 1}: not both pictures came, but {pictures}")
            waits["first look"].append(first[0])
            waits["prediction"].append(last[-1])
        browser.close()
    for what, times in waits.items():
        late = quantiles(times, n=20)[-1]
        print(f"{what}: median {median(times):.0f}, p95 {late:.0f}, longest {max(times):.0f} ms, {len(times)} keys")


if __name__ == "__main__":
    main()
