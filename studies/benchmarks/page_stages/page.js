// Runs the worker that the address names and writes what it says.

const worker = new Worker(`/benchmarks/${location.hash.slice(1)}.worker.js`, { type: "module" });
const tell = (text) => {
  document.getElementById("result").textContent = text;
};
worker.onmessage = ({ data }) => tell(JSON.stringify(data));
worker.onerror = (error) => tell(JSON.stringify({ failed: `${error.message} ${error.filename}:${error.lineno}` }));
