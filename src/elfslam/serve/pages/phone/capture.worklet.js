/** Runs on the thread of the sound: sends the microphone's samples straight to workers. */

const BLOCK = 1024;

class Capture extends AudioWorkletProcessor {
  constructor() {
    super();
    /** @type {Map<string, MessagePort>} by name */
    this.sinks = new Map();
    this.block = new Float32Array(BLOCK);
    this.filled = 0;
    this.first = 0;
    this.port.onmessage = ({ data: { to, sink } }) => {
      if (sink) this.sinks.set(to, sink);
      else this.sinks.delete(to);
    };
  }

  /** @param {Float32Array[][]} inputs by input and channel */
  process([input]) {
    const samples = input[0];
    if (this.sinks.size === 0 || !samples) return true;
    if (this.filled === 0 || currentFrame !== this.first + this.filled) this.begin();
    this.block.set(samples, this.filled);
    this.filled += samples.length;
    if (this.filled + samples.length > BLOCK) this.send();
    return true;
  }

  /** Where samples were lost, what was gathered before them goes on its own. */
  begin() {
    if (this.filled > 0) this.send();
    this.first = currentFrame;
  }

  send() {
    for (const sink of this.sinks.values()) {
      const samples = this.block.slice(0, this.filled);
      sink.postMessage({ first: this.first, samples }, [samples.buffer]);
    }
    this.filled = 0;
  }
}

registerProcessor("capture", Capture);
