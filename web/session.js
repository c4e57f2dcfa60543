/** The simulation in its worker: sends what to do, and gives what comes back to those who listen. */

/**
 * @typedef {object} Session
 * @property {(message: Record<string, any>) => void} send
 * @property {(got: string, act: (message: any) => void) => void} on
 */

/** Start the worker of this page.
 * @returns {Session} */
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
    send: (message) => worker.postMessage(message),
    on: (got, act) => listeners.set(got, [...(listeners.get(got) ?? []), act]),
  };
}
