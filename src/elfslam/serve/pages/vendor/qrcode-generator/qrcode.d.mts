interface QrCode {
  addData(text: string): void;
  make(): void;
  createSvgTag(options: { cellSize?: number; margin?: number; scalable?: boolean }): string;
  getModuleCount(): number;
  isDark(row: number, column: number): boolean;
}
export function qrcode(typeNumber: number, errorCorrectionLevel: string): QrCode;
