// The way to the server: the gateway's WebSocket, or the transport that a notebook gives.
//
// | state        | event                   | goes to                                             |
// |--------------|-------------------------|-----------------------------------------------------|
// | connecting   | open                    | open                                                |
// | connecting   | closed, or 2 s are over | by transport, if there is one; else waiting         |
// | open         | closed                  | waiting: 0.5 s, twice as long each time, up to 8 s  |
// | waiting      | the time is over        | connecting, once the tab is shown                   |
// | by transport | closed                  | by transport: it has no end but `end`               |
// @ts-check

import { untilShown } from './tab.js';
import { startWorker } from './worker.js';

/** @typedef {import('./client.js').Client} Client */
/** @typedef {import('./notices.js').Notices} Notices */

/**
 * @typedef {object} Transport A way to the server besides the gateway's WebSocket.
 * @property {string} name
 * @property {(receive: (message: ArrayBuffer) => void) => void} open
 * @property {(text: string) => void} send
 * @property {() => void} close
 */

export class Connection {
  isOpen = false;
  /** Attempts since the connection was last steady. */
  attempt = 0;
  #client;
  #notices;
  #on;
  #worker;
  #transport;
  #isTransportFirst;
  #isByTransport = false;
  #isEnded = false;
  #wasOpen = false;
  /** The sentence of the lost connection, until there is one again. */
  #lost = '';
  /** @type {Record<string, ReturnType<typeof setTimeout> | undefined>} */
  #timers = {};

  /**
   * @param {Client} client @param {Notices} notices
   * @param {{transport?: Transport, isTransportFirst: boolean}} way which is tried first
   * @param {{status: (kind: string, sentence: string) => void, opened: (isAgain: boolean) => void, closed: () => void,
   *   message: (message: any) => void}} on what happens; `message` gets frame, dropped and bad of the worker
   */
  constructor(client, notices, { transport, isTransportFirst }, on) {
    this.#client = client;
    this.#notices = notices;
    this.#transport = transport;
    this.#isTransportFirst = isTransportFirst;
    this.#on = on;
    this.#worker = startWorker((message) => this.#receive(message));
  }

  get isInWorker() {
    return this.#worker.isWorker;
  }

  /** The name of the transport, or 'gateway'. */
  get name() {
    return this.#isByTransport ? this.#transport?.name ?? '' : 'gateway';
  }

  async connect() {
    await untilShown();
    if (this.#isEnded || this.isOpen) {
      return;
    }
    this.#on.status('connecting', '');
    if (this.#transport && this.#isTransportFirst) {
      this.#useTransport(this.#transport);
      return;
    }
    this.#worker.post({ kind: 'open', url: this.#client.socketAddress, protocols: this.#client.socketProtocols });
    clearTimeout(this.#timers.open);
    this.#timers.open = setTimeout(() => {
      if (this.isOpen) {
        return;
      }
      if (this.#transport && !this.#wasOpen) {
        this.#useTransport(this.#transport);
      } else {
        this.#notices.show(`Connecting to ${this.#client.base.host} …`, 'busy');
      }
    }, 2000);
  }

  /** @param {string} text */
  send(text) {
    this.#worker.post({ kind: 'send', text });
  }

  /**
   * Says that a frame was shown or dropped, with the time of its decoding.
   * @param {any} message of the worker
   */
  acknowledge(message) {
    const { header: { frameNumber }, generation, decodeMs } = message;
    if (frameNumber) {
      this.#worker.post({ kind: 'shown', generation, frameNumber, decodeMs });
    }
  }

  end() {
    this.#isEnded = true;
    Object.values(this.#timers).forEach((timer) => clearTimeout(timer));
    this.#transport?.close();
    this.#worker.stop();
  }

  /** @param {any} message of the worker */
  #receive(message) {
    if (this.#isEnded) {
      message.bitmap?.close();
      return;
    }
    switch (message.kind) {
      case 'open': this.#opened(); break;
      case 'closed': this.#closed(message.reason); break;
      case 'outgoing':
        if (this.#isByTransport) {
          this.#transport?.send(message.text);
        }
        break;
      default: this.#on.message(message);
    }
  }

  /** @param {Transport} transport */
  #useTransport(transport) {
    this.#worker.post({ kind: 'close' });
    this.#isByTransport = true;
    transport.open((buffer) => this.#worker.post({ kind: 'data', buffer }, [buffer]));
    this.#opened();
  }

  #opened() {
    clearTimeout(this.#timers.open);
    const isAgain = this.#wasOpen;
    // A connection that soon ends again is retried at increasing intervals.
    clearTimeout(this.#timers.steady);
    this.#timers.steady = setTimeout(() => { this.attempt = 0; }, 5000);
    this.isOpen = true;
    this.#wasOpen = true;
    this.#notices.clear();
    if (this.#lost) {
      this.#lost = '';
      this.#notices.announce('Connected again.');
    }
    this.#on.status('open', '');
    this.#on.opened(isAgain);
  }

  /** @param {string} reason */
  #closed(reason) {
    if (this.#isByTransport) {
      return;
    }
    if (this.#transport && !this.#wasOpen) {
      this.#useTransport(this.#transport);
      return;
    }
    this.isOpen = false;
    this.#on.closed();
    clearTimeout(this.#timers.open);
    clearTimeout(this.#timers.steady);
    const seconds = Math.min(8, 0.5 * 2 ** this.attempt);
    this.attempt += 1;
    const loss = reason ? `The connection ended: ${reason.replace(/\.*$/, '')}.`
      : this.#wasOpen ? `The connection to ${this.#client.base.host} was lost.`
        : `No connection to ${this.#client.socketAddress}. Is isoscope-gateway (or \`isoscope ` +
          'view`) running there, and does a proxy in between pass WebSocket connections on?';
    const sentence = `${loss} Trying again in ${seconds} s.`;
    this.#notices.show(sentence, 'error');
    if (!this.#lost) {  // once, however often the connection is tried
      this.#lost = loss;
      this.#notices.announce(loss);
    }
    this.#on.status('closed', sentence);
    if (!reason && !this.#wasOpen) {
      this.#askWhy();
    }
    clearTimeout(this.#timers.retry);
    this.#timers.retry = setTimeout(() => this.connect(), 1000 * seconds * (0.85 + 0.3 * Math.random()));
  }

  /** A browser does not tell why a WebSocket was refused. The same gateway says over HTTP if the token is missing. */
  async #askWhy() {
    await untilShown();
    try {
      await this.#client.requestOnce('v1/capabilities');
    } catch (error) {
      const { status, message } = /** @type {Error & {status?: number}} */ (error);
      if ((status === 401 || status === 403) && !this.isOpen && !this.#isEnded) {
        this.#notices.show(message, 'error');
        this.#notices.announce(message);
      }
    }
  }
}
