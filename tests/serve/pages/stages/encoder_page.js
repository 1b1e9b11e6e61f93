const worker = new Worker("/test/encoder.worker.js", { type: "module" });
worker.onmessage = ({ data }) => {
  document.getElementById("result").textContent = JSON.stringify(data);
};
worker.onerror = ({ message }) => {
  document.getElementById("result").textContent = JSON.stringify({ failed: message });
};
