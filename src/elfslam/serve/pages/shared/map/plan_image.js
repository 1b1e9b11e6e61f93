// The picture of a floor plan, and its negative for dark pages.

/** @param {string} address @returns {Promise<{image: HTMLImageElement, negative: HTMLCanvasElement,
 *   aspect: number, inverted: null}>} aspect: height by width; inverted: nobody said */
export async function loadPlanImage(address) {
  const image = new Image();
  image.src = address;
  await image.decode();
  return {
    image,
    negative: negativeOf(image),
    aspect: image.naturalHeight / image.naturalWidth,
    inverted: null,
  };
}

/** Whether the negative is shown: as somebody said, else where the page is dark now. @param {{inverted: boolean | null}} plan */
export function isNegative({ inverted }) {
  return inverted ?? matchMedia("(prefers-color-scheme: dark)").matches;
}

/** @param {HTMLImageElement} image */
function negativeOf(image) {
  const canvas = Object.assign(document.createElement("canvas"), { width: image.naturalWidth, height: image.naturalHeight });
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.drawImage(image, 0, 0);
  context.globalCompositeOperation = "difference";
  context.fillStyle = "white";
  context.fillRect(0, 0, canvas.width, canvas.height);
  // A transparent image has become white where it was clear: give it its own outline back.
  context.globalCompositeOperation = "destination-in";
  context.drawImage(image, 0, 0);
  return canvas;
}
