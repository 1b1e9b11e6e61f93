// What browsers have besides: TypeScript's libraries for pages do not declare it. In workers alone:
interface FileSystemFileHandle {
  createSyncAccessHandle(): Promise<FileSystemSyncAccessHandle>;
}
interface FileSystemSyncAccessHandle {
  close(): void;
  flush(): void;
  getSize(): number;
  read(bytes: AllowSharedBufferSource, options: { at: number }): number;
  truncate(size: number): void;
  write(bytes: AllowSharedBufferSource, options: { at: number }): number;
}

/** What the service worker calls itself, as far as ours asks. */
interface ServiceWorkerScope {
  readonly clients: {
    claim(): Promise<void>;
    matchAll(options: { type: "window"; includeUncontrolled: boolean }): Promise<WindowOfPage[]>;
  };
  readonly location: Location;
  addEventListener(type: "install" | "activate", heard: (event: ExtendableEvent) => void): void;
  addEventListener(type: "message", heard: (event: ExtendableEvent & { readonly data: unknown }) => void): void;
  addEventListener(type: "fetch", heard: (event: FetchEvent) => void): void;
  skipWaiting(): Promise<void>;
}
interface ExtendableEvent extends Event {
  waitUntil(work: Promise<unknown>): void;
}
interface FetchEvent extends ExtendableEvent {
  readonly clientId: string;
  readonly request: Request;
  readonly resultingClientId: string;
  respondWith(answer: Promise<Response>): void;
}
interface WindowOfPage {
  readonly url: string;
  postMessage(message: unknown): void;
}
/** The server writes it above the service worker. */
declare const VERSION: string;

/** What shared/language.js leaves for the modules of a page. */
interface ElfslamLanguage {
  readonly language: string;
  readonly languages: string[];
  readonly locale: string;
  /** Null where it could not be had. */
  readonly catalogue: Promise<Record<string, string> | null>;
  choose(language: string): void;
}
declare var elfslamLanguage: ElfslamLanguage | undefined;
