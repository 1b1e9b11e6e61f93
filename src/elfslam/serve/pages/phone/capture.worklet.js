/** Runs on the thread of the sound: sends the microphone's samples straight to a worker. */

const BLOCK = 1024;

class Capture extends AudioWorkletProcessor {
  constructor() {
    super();
    this.sink = null;
    this.block = new Float32Array(BLOCK);
    this.filled = 0;
    this.first = 0;
    this.port.onmessage = ({ data }) => {
      this.sink = data.sink;
    };
  }

  process([input]) {
    const samples = input[0];
    if (!this.sink || !samples) return true;
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
    const samples = this.block.slice(0, this.filled);
    this.sink.postMessage({ first: this.first, samples }, [samples.buffer]);
    this.filled = 0;
  }
}

registerProcessor("capture", Capture);
