/** As far as the pages use it. */
interface Words {
  init(options: Record<string, unknown>): unknown;
  t(key: string, values?: Record<string, unknown>): string;
}
export function createInstance(): Words;
