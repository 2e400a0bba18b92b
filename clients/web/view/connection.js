// The way to the server: the gateway's WebSocket, or the transport that a notebook gives.
//
// | state        | event                   | goes to                                             |
// |--------------|-------------------------|-----------------------------------------------------|
// | connecting   | open                    | open                                                |
// | connecting   | closed, or 2 s are over | by transport, if there is one; else waiting         |
// | open         | closed                  | waiting: 0.5 s, twice as long each time, up to 8 s  |
// | waiting      | the time is over        | connecting, once the tab is shown                   |
// | waiting      | HTTP answers 401        | refused: nothing is tried until `again`             |
// | by transport | closed                  | by transport: it has no end but `end`               |
// @ts-check

import { untilShown } from './tab.js';
import { startWorker } from './worker.js';

/** The code of a WebSocket that the server ends for what the client has sent, such as its token. */
const POLICY_VIOLATION = 1008;
/** So long a gateway may take to say why it refused a WebSocket, before the loss is told, in milliseconds. */
const REASON_MS = 300;

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
  #isRefused = false;
  /** The sentence of the lost connection, until there is one again. */
  #lost = '';
  /** @type {Record<string, ReturnType<typeof setTimeout> | undefined>} */
  #timers = {};

  /**
   * @param {Client} client @param {Notices} notices
   * @param {{transport?: Transport, isTransportFirst: boolean}} way which is tried first
   * @param {{status: (kind: string, sentence: string) => boolean, opened: (isAgain: boolean) => void, closed: () => void,
   *   message: (message: any) => void}} on what happens; `status` says false if somebody else tells it; `message` gets
   *   frame, dropped and bad of the worker
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

  /** Tries at once, with the client's token of now: also after a refusal. */
  again() {
    this.#isRefused = false;
    this.attempt = 0;
    clearTimeout(this.#timers.retry);
    this.connect();
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
      case 'closed': this.#closed(message.code, message.reason); break;
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
    clearTimeout(this.#timers.tell);
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

  /** @param {number} code of the WebSocket @param {string} reason */
  #closed(code, reason) {
    if (this.#isByTransport || this.#isRefused) {
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
    this.#on.status('closed', sentence);
    clearTimeout(this.#timers.tell);
    if (reason && code !== POLICY_VIOLATION) {
      this.#tellLoss(loss, sentence);
    } else {
      this.#timers.tell = setTimeout(() => this.#tellLoss(loss, sentence), REASON_MS);
      this.#askWhy();
    }
    clearTimeout(this.#timers.retry);
    this.#timers.retry = setTimeout(() => this.connect(), 1000 * seconds * (0.85 + 0.3 * Math.random()));
  }

  /** @param {string} loss @param {string} sentence the same, with the time of the next attempt */
  #tellLoss(loss, sentence) {
    this.#notices.show(sentence, 'error');
    if (!this.#lost) {  // once, however often the connection is tried
      this.#lost = loss;
      this.#notices.announce(loss);
    }
  }

  /** A browser does not tell why a WebSocket was refused. The same gateway says over HTTP if the token is wrong. */
  async #askWhy() {
    await untilShown();
    try {
      await this.#client.requestOnce('v1/capabilities');
    } catch (error) {
      const { status, message } = /** @type {Error & {status?: number}} */ (error);
      if (this.isOpen || this.#isEnded || this.#isRefused) {
        return;
      }
      if (status === 401) {
        this.#refuse(message);
      } else if (status === 403) {
        clearTimeout(this.#timers.tell);
        this.#tellLoss(message, message);
      }
    }
  }

  /**
   * Another attempt with the same token would be refused, too.
   * @param {string} sentence
   */
  #refuse(sentence) {
    this.#isRefused = true;
    clearTimeout(this.#timers.retry);
    clearTimeout(this.#timers.tell);
    clearTimeout(this.#timers.open);
    this.#lost = '';
    if (this.#on.status('refused', sentence)) {
      this.#notices.show(sentence, 'error');
      this.#notices.announce(sentence);
    } else {
      this.#notices.clear();
    }
  }
}
