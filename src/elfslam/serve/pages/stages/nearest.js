/** The nearest of many points in four dimensions: a k-d tree that gives what scipy.spatial.cKDTree gives. */

const AXES = 4;
const LEAF = 12;

/**
 * @typedef {{order: Int32Array, points: Float64Array, nodes: Float64Array, children: Int32Array}} Tree
 *   points (4m) in the order of the tree; per node (3): axis, the last below the cut, the first above it;
 *   per node (2): its children, or -1 - start and stop of its points
 */

/**
 * @param {Float64Array} points (4m)
 * @returns {Tree}
 */
export function treeOf(points) {
  const order = Int32Array.from({ length: points.length / AXES }, (_, k) => k);
  /** @type {number[]} */
  const nodes = [];
  /** @type {number[]} */
  const children = [];
  grow(points, order, 0, order.length, nodes, children);
  const sorted = new Float64Array(points.length);
  order.forEach((point, k) => sorted.set(points.subarray(AXES * point, AXES * point + AXES), AXES * k));
  return { order, points: sorted, nodes: Float64Array.from(nodes), children: Int32Array.from(children) };
}

/**
 * Cuts the longest side of a box in its middle point until few are left.
 * @param {Float64Array} points @param {Int32Array} order @param {number} start @param {number} stop
 * @param {number[]} nodes @param {number[]} children
 * @returns {number} the node
 */
function grow(points, order, start, stop, nodes, children) {
  const node = children.length / 2;
  nodes.push(0, 0, 0);
  children.push(-1 - start, stop);
  if (stop - start <= LEAF) return node;
  const axis = widestAxis(points, order, start, stop);
  const part = order.subarray(start, stop);
  part.sort((a, b) => points[AXES * a + axis] - points[AXES * b + axis]);
  const middle = (start + stop) >> 1;
  nodes[3 * node] = axis;
  nodes[3 * node + 1] = points[AXES * order[middle - 1] + axis];
  nodes[3 * node + 2] = points[AXES * order[middle] + axis];
  children[2 * node] = grow(points, order, start, middle, nodes, children);
  children[2 * node + 1] = grow(points, order, middle, stop, nodes, children);
  return node;
}

/** @param {Float64Array} points @param {Int32Array} order @param {number} start @param {number} stop */
function widestAxis(points, order, start, stop) {
  let best = 0;
  let widest = -1;
  for (let axis = 0; axis < AXES; axis += 1) {
    let [low, high] = [Infinity, -Infinity];
    for (let k = start; k < stop; k += 1) {
      const value = points[AXES * order[k] + axis];
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
    if (high - low > widest) [best, widest] = [axis, high - low];
  }
  return best;
}

/**
 * Asks for the `count` nearest points within a distance; the answer is written over at the next question.
 * @param {Tree} tree @param {number} count
 * @returns {(a: number, b: number, c: number, d: number, furthest: number) =>
 *   {found: number, indices: Int32Array, squares: Float64Array}}
 *   how many there are, and their rows and squared distances, nearest first
 */
export function nearestIn({ order, points, nodes, children }, count) {
  const answer = { found: 0, indices: new Int32Array(count), squares: new Float64Array(count) };
  const { indices, squares } = answer;
  const at = new Float64Array(AXES);
  let within = Infinity;

  /** @param {number} start @param {number} stop */
  const look = (start, stop) => {
    for (let k = start; k < stop; k += 1) {
      let square = 0;
      for (let axis = 0; axis < AXES; axis += 1) square += (points[AXES * k + axis] - at[axis]) ** 2;
      if (square < within) insert(order[k], square);
    }
  };
  /** @param {number} index @param {number} square */
  const insert = (index, square) => {
    let place = Math.min(answer.found, count - 1);
    for (; place > 0 && squares[place - 1] > square; place -= 1) {
      squares[place] = squares[place - 1];
      indices[place] = indices[place - 1];
    }
    squares[place] = square;
    indices[place] = index;
    answer.found = Math.min(answer.found + 1, count);
    if (answer.found === count) within = Math.min(within, squares[count - 1]);
  };
  /** @param {number} node @returns {void} */
  const descend = (node) => {
    const first = children[2 * node];
    if (first < 0) return look(-1 - first, children[2 * node + 1]);
    const value = at[nodes[3 * node]];
    const above = value - nodes[3 * node + 1];
    const below = nodes[3 * node + 2] - value;
    if (above < below) {
      descend(first);
      if (below <= 0 || below * below < within) descend(children[2 * node + 1]);
    } else {
      descend(children[2 * node + 1]);
      if (above <= 0 || above * above < within) descend(first);
    }
    return undefined;
  };
  return (a, b, c, d, furthest) => {
    [at[0], at[1], at[2], at[3]] = [a, b, c, d];
    within = furthest * furthest;
    answer.found = 0;
    descend(0);
    return answer;
  };
}
