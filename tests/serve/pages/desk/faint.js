// Text whose contrast with what lies behind it is less than WCAG 2.2 asks for (AA).
() => {
  const [LEAST, LEAST_OF_LARGE] = [4.5, 3];
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const rgba = (colour) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = colour;
    canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  };
  const over = (top, below) =>
    top.slice(0, 3).map((value, k) => (value * top[3] + below[k] * (255 - top[3])) / 255);
  const ground = (element) => {
    const layers = [];
    for (let at = element; at; at = at.parentElement) {
      layers.push(rgba(getComputedStyle(at).backgroundColor));
    }
    const canvasColour = rgba("Canvas").slice(0, 3);
    return layers.reverse().reduce((below, top) => over(top, below), canvasColour);
  };
  const linear = (value) =>
    value / 255 <= 0.04045 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4;
  const light = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const left_out =
    "canvas, :disabled, [aria-disabled=true], .visually-hidden, .skip, noscript, .drop-here";
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement;
    const words = node.textContent.trim();
    if (!words || !element.checkVisibility() || element.closest(left_out)) continue;
    const style = getComputedStyle(element);
    const below = ground(element);
    const lights = [light(over(rgba(style.color), below)), light(below)].sort((a, b) => a - b);
    const ratio = (lights[1] + 0.05) / (lights[0] + 0.05);
    const size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    if (ratio < (large ? LEAST_OF_LARGE : LEAST)) {
      found.push(`${ratio.toFixed(2)} ${words.slice(0, 40)}`);
    }
  }
  return found;
}
