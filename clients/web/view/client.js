// The HTTP side of a gateway.
// @ts-check

import { untilShown } from './tab.js';

/** Refusals are asked again for so long. */
const RETRY_MS = 30000;

/**
 * Waits; throws the reason of a signal that aborts before the end.
 * @param {number} ms @param {AbortSignal | null} [signal] @returns {Promise<void>}
 */
function sleep(ms, signal) {
  return new Promise((resolve, reject) => {
    const abort = () => {
      clearTimeout(timer);
      reject(signal?.reason);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener('abort', abort);
      resolve();
    }, ms);
    if (signal?.aborted) {
      abort();
    } else {
      signal?.addEventListener('abort', abort, { once: true });
    }
  });
}

/** The protocol of the gateway's WebSocket, and one whose name carries the token: browsers give it no header. */
const PROTOCOL = 'isoscope';
const BEARER_PROTOCOL = 'isoscope.bearer.';

/**
 * The HTTP side of a gateway. Every error is an Error with a sentence, `code` and `status`. The
 * token is sent in headers, never in an address. A token in the address of the surrounding page,
 * such as a notebook's, is not touched.
 */
export class Client {
  /**
   * @param {string} [url] of the gateway, maybe with `?token=`; default: the page's own folder
   * @param {string} [token]
   */
  constructor(url = '', token = '') {
    this.base = new URL(url || './', document.baseURI);
    if (!this.base.pathname.endsWith('/')) {
      this.base.pathname = this.base.pathname.replace(/[^/]*$/, '');
    }
    this.token = token || this.base.searchParams.get('token') || '';
    this.base.search = '';
    this.base.hash = '';
  }

  /** @param {string} path */
  address(path) {
    return new URL(path, this.base).href;
  }

  get socketAddress() {
    return this.address('v1/interact').replace(/^http/, 'ws');
  }

  /** The protocols that the WebSocket offers. The gateway chooses the first one. */
  get socketProtocols() {
    const text = String.fromCharCode(...new TextEncoder().encode(this.token));
    const coded = btoa(text).replaceAll('+', '-').replaceAll('/', '_').replaceAll('=', '');
    return coded ? [PROTOCOL, BEARER_PROTOCOL + coded] : [];
  }

  /**
   * Retries after the delay of a refusal, within RETRY_MS. Waits while the tab is hidden.
   * @param {string} path @param {RequestInit} [init] @returns {Promise<Response>}
   */
  async request(path, init) {
    const start = performance.now();
    for (;;) {
      await untilShown();
      try {
        return await this.requestOnce(path, init);
      } catch (error) {
        const delay = /** @type {{retryDelay?: number}} */ (error).retryDelay;
        if (delay === undefined || performance.now() - start + delay > RETRY_MS) {
          throw error;
        }
        await sleep(delay, init?.signal);
      }
    }
  }

  /** @param {string} path @param {RequestInit} [init] @returns {Promise<Response>} */
  async requestOnce(path, init) {
    let response;
    try {
      const headers = { ...init?.headers, ...(this.token ? { Authorization: `Bearer ${this.token}` } : {}) };
      response = await fetch(this.address(path), { ...init, headers });
    } catch (error) {
      if (/** @type {Error} */ (error).name === 'AbortError') {
        throw error;
      }
      throw Object.assign(new Error(`The gateway at ${this.base.href} does not answer. Is isoscope-gateway (or ` +
        '`isoscope view`) still running, and is the network up?'), { code: 'UNAVAILABLE', status: 0 });
    }
    if (!response.ok) {
      let body = { code: '', message: '', retry_delay_ms: /** @type {number | undefined} */ (undefined) };
      try {
        body = await response.json();
      } catch {
        // Not from the gateway: a proxy's page.
      }
      const delay = body.retry_delay_ms;
      throw Object.assign(new Error(body.message || `The gateway answered with HTTP status ${response.status}.`),
        { code: body.code || 'UNKNOWN', status: response.status,
          retryDelay: typeof delay === 'number' && delay >= 0 ? delay : undefined });
    }
    return response;
  }

  /** @param {string} path @returns {Promise<any>} */
  async get(path) {
    return (await this.request(path)).json();
  }

  /** @param {string} path @param {any} body @param {AbortSignal} [signal] @returns {Promise<Response>} */
  post(path, body, signal) {
    return this.request(path, { method: 'POST', body: JSON.stringify(body), signal,
      headers: { 'Content-Type': 'application/json' } });
  }
}
