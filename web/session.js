/** The simulation in its worker: sends what to do, and gives what comes back to those who listen. */

/** Start the worker of this page. */
export function startSession() {
  const source = document.getElementById("worker")?.textContent ?? "";
  const address = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
  const worker = new Worker(address);
  /** @type {Map<string, ((message: any) => void)[]>} */
  const listeners = new Map();
  const give = (/** @type {any} */ message) => (listeners.get(message.got) ?? []).forEach((act) => act(message));
  worker.onmessage = ({ data }) => give(data);
  worker.onerror = (event) =>
    give({ got: "error", message: `the simulation could not start: ${event.message || "its worker was refused"}` });
  return {
    send: (/** @type {Record<string, any>} */ message) => worker.postMessage(message),
    on: (/** @type {string} */ got, /** @type {(message: any) => void} */ act) => listeners.set(got, [...(listeners.get(got) ?? []), act]),
  };
}
