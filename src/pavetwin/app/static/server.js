// What the page asks of the server: files over HTTP, tasks over one WebSocket. A task is cancelled by `cancel()`, and by
// leaving the page.

export async function fetchJson(path) {
  const answer = await fetch(path);
  const values = await answer.json();
  if (!answer.ok) throw new Error(values.error ?? answer.statusText);
  return values;
}

export async function fetchText(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error((await answer.json()).error ?? answer.statusText);
  return answer.text();
}

export async function fetchBytes(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error((await answer.json()).error ?? answer.statusText);
  return answer.arrayBuffer();
}

export class CancelledError extends Error {}

export class Tasks {
  #socket = null;
  #number = 0;
  #asked = new Map();
  #waiting = [];
  #isThere = true;
  #onConnection;

  /** @param onConnection called with whether the server answers, when that changes */
  constructor(onConnection) {
    this.#onConnection = onConnection;
    this.#connect();
  }

  /** Start a task. Returns `{ promise, cancel, send }`; `onReport` gets `{ share, what }`, `{ ready }` and `{ live }`. */
  ask(task, onReport = () => {}) {
    const id = ++this.#number;
    const promise = new Promise((resolve, reject) => this.#asked.set(id, { resolve, reject, onReport }));
    this.#send({ ...task, id });
    return { promise, cancel: () => this.#send({ id, do: 'cancel' }), send: stick => this.#send({ id, do: 'steer', stick }) };
  }

  #send(message) {
    const text = JSON.stringify(message);
    if (this.#socket.readyState === WebSocket.OPEN) this.#socket.send(text);
    else this.#waiting.push(text); // until there is a connection again, or none can be made
  }

  #connect() {
    this.#socket = new WebSocket(`ws://${location.host}/live`);
    this.#socket.addEventListener('open', () => {
      this.#setConnected(true);
      for (const text of this.#waiting.splice(0)) this.#socket.send(text);
    });
    this.#socket.addEventListener('message', event => this.#take(JSON.parse(event.data)));
    this.#socket.addEventListener('close', () => {
      for (const { reject } of this.#asked.values()) reject(new Error('The server has ended, or cannot be reached.'));
      this.#asked.clear();
      this.#waiting = [];
      this.#setConnected(false);
      setTimeout(() => this.#connect(), 2000);
    });
  }

  #setConnected(isThere) {
    if (isThere === this.#isThere) return;
    this.#isThere = isThere;
    this.#onConnection(isThere);
  }

  #take(message) {
    const task = this.#asked.get(message.id);
    if (!task) return;
    if ('share' in message || 'ready' in message || 'live' in message) return task.onReport(message);
    this.#asked.delete(message.id);
    if ('done' in message) task.resolve(message.done);
    else task.reject(message.cancelled ? new CancelledError() : new Error(message.error));
  }
}
