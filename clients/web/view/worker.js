// The worker: it holds the WebSocket, takes messages apart and decodes pictures, away from the page.
//
// Messages to it: open {url, protocols}, send {text}, data {buffer} of another way than the socket,
// shown {generation, frameNumber, decodeMs}, close. From it: open {generation}, closed {code, reason},
// frame {header, bitmap, depths, ...}, which may be a tile, or an answer without a picture, dropped {sequence, bytes},
// bad {sentence}, and outgoing {text} for what no socket takes.
// @ts-check

/**
 * Parses a message of the gateway: u32 length of JSON, JSON, picture, depths (docs/gateway.md). Throws
 * an Error that describes the fault. Self-contained, as workerMain.
 * @param {ArrayBuffer} buffer
 * @returns {{header: any, image: Uint8Array, depths: Uint16Array}}
 */
export function parseMessage(buffer) {
  /** @param {string} why @returns {never} */
  const fail = (why) => {
    throw new Error(`The server sent a message of ${buffer.byteLength} bytes that is no frame: ${why}.`);
  };
  if (buffer.byteLength < 4) {
    fail('it is too short');
  }
  const view = new DataView(buffer);
  const jsonBytes = view.getUint32(0, true);
  if (jsonBytes > buffer.byteLength - 4) {
    fail(`its header says that it has ${jsonBytes} bytes`);
  }
  /** @type {any} */
  let header = null;
  try {
    header = JSON.parse(new TextDecoder('utf-8', { fatal: true }).decode(new Uint8Array(buffer, 4, jsonBytes)));
  } catch {
    fail('its header is no JSON');
  }
  if (header === null || typeof header !== 'object' || Array.isArray(header)) {
    fail('its header is no object');
  }
  const imageBytes = header.image?.bytes ?? 0;
  const depthBytes = header.depthBytes ?? 0;
  for (const count of [imageBytes, depthBytes]) {
    if (!Number.isSafeInteger(count) || count < 0) {
      fail(`a size in its header is ${JSON.stringify(count)}`);
    }
  }
  if (4 + jsonBytes + imageBytes + depthBytes !== buffer.byteLength) {
    fail(`its parts have ${4 + jsonBytes + imageBytes + depthBytes} bytes`);
  }
  if (imageBytes > 0 && header.image.type !== 'image/jpeg' && header.image.type !== 'image/png') {
    fail(`the type of its picture is ${JSON.stringify(header.image.type)}`);
  }
  const number = Number(header.frameNumber ?? 0);
  if (!Number.isSafeInteger(number) || number < 0) {
    fail(`its frame number is ${JSON.stringify(header.frameNumber)}`);
  }
  const grid = header.depthGrid;
  if (depthBytes > 0 && !(grid && grid.width > 0 && grid.height > 0 && grid.width <= 4096 &&
      2 * grid.width * grid.height === depthBytes)) {
    fail(`its grid of depths has ${depthBytes} bytes`);
  }
  const start = 4 + jsonBytes;
  const depths = new Uint16Array(buffer.slice(start + imageBytes, start + imageBytes + depthBytes));
  if (new Uint8Array(new Uint16Array([1]).buffer)[0] === 0) {  // a big-endian machine
    const source = new DataView(depths.buffer);
    depths.forEach((_, i) => { depths[i] = source.getUint16(2 * i, true); });
  }
  return { header, image: new Uint8Array(buffer, start, imageBytes), depths };
}

/**
 * Decodes the picture of a message; null if it has none. Self-contained, as workerMain.
 * @param {Uint8Array} image @param {string} type of its header @returns {Promise<ImageBitmap | null>}
 */
async function decodePicture(image, type) {
  if (image.byteLength === 0) {
    return null;
  }
  const blob = new Blob([image], { type });
  try {
    // A JPEG has neither alpha nor profile; requesting them would cost a pass over its pixels.
    return await (type === 'image/jpeg' ? createImageBitmap(blob)
      : createImageBitmap(blob, { premultiplyAlpha: 'none', colorSpaceConversion: 'none' }));
  } catch {
    throw new Error(`The browser cannot decode the ${type} picture that the server sent.`);
  }
}

/**
 * Returns the message to the page for one of the server. Self-contained, as workerMain.
 * @param {typeof parseMessage} parse @param {ArrayBuffer} buffer @param {number} receivedAt
 */
async function decodeMessage(parse, buffer, receivedAt) {
  const startedAt = performance.now();
  const { header, image, depths } = parse(buffer);
  const bitmap = await decodePicture(image, header.image?.type);
  return { kind: 'frame', header, bitmap, depths, bytes: buffer.byteLength,
    receivedAt: performance.timeOrigin + receivedAt, decodeMs: performance.now() - startedAt };
}

/**
 * Decodes one picture at a time; one waits, and behind it what adds to it, such as tiles. A further one replaces all
 * that wait, which `drop` gets. Self-contained, as workerMain.
 * @param {(buffer: ArrayBuffer, receivedAt: number) => Promise<void>} decode
 * @param {(buffer: ArrayBuffer) => void} drop
 * @param {(buffer: ArrayBuffer) => boolean} addsToPicture
 */
function makeQueue(decode, drop, addsToPicture) {
  const most = 64;  // servers wait for answers long before
  let isDecoding = false;
  /** @type {{buffer: ArrayBuffer, receivedAt: number}[]} */
  let waiting = [];
  return {
    clear() { waiting = []; },
    /** @param {ArrayBuffer} buffer */
    async push(buffer) {
      const receivedAt = performance.now();
      if (isDecoding) {
        const dropped = waiting.splice(0, addsToPicture(buffer) ? Math.max(0, waiting.length + 1 - most) : waiting.length);
        waiting.push({ buffer, receivedAt });
        dropped.forEach((one) => drop(one.buffer));
        return;
      }
      isDecoding = true;
      /** @type {{buffer: ArrayBuffer, receivedAt: number} | undefined} */
      let next = { buffer, receivedAt };
      while (next) {
        await decode(next.buffer, next.receivedAt);
        next = waiting.shift();
      }
      isDecoding = false;
    },
  };
}

/**
 * Owns the WebSocket; null while there is none. `on` hears of it. Self-contained, as workerMain.
 * @param {{open: () => void, closed: (code: number, reason: string) => void, data: (buffer: ArrayBuffer) => void,
 *   bad: (sentence: string) => void, ended: () => void}} on `ended` comes before a socket is given up
 */
function makeSocket(on) {
  /** @type {WebSocket | null} */
  let socket = null;
  const close = () => {
    on.ended();
    if (socket) {
      socket.onopen = socket.onmessage = socket.onclose = null;
      socket.close();
      socket = null;
    }
  };
  return {
    close,
    /** @param {string} text @returns {boolean} false if there is no open socket */
    send(text) {
      if (socket?.readyState !== 1) {
        return false;
      }
      socket.send(text);
      return true;
    },
    /** @param {string} url @param {string[]} protocols */
    open(url, protocols) {
      close();
      try {
        socket = new WebSocket(url, protocols);
      } catch (error) {
        on.closed(0, String(/** @type {Error} */ (error).message));
        return;
      }
      socket.binaryType = 'arraybuffer';
      socket.onopen = on.open;
      socket.onmessage = (event) => {
        if (event.data instanceof ArrayBuffer) {
          on.data(event.data);
        } else {
          on.bad('The server sent text where a frame was expected.');
        }
      };
      socket.onclose = (event) => {
        close();
        on.closed(event.code, event.reason);
      };
    },
  };
}

/**
 * Owns socket and decoding. Self-contained: it is started from its source and that of the functions above.
 * @param {{postMessage: (message: any, transfer?: any[]) => void,
 *   onmessage: ((event: {data: any}) => void) | null}} scope
 * @param {typeof parseMessage} parse
 */
export function workerMain(scope, parse) {
  let generation = 0;
  /** @param {string} sentence */
  const bad = (sentence) => scope.postMessage({ kind: 'bad', sentence });
  const queue = makeQueue(async (buffer, receivedAt) => {
    const mine = generation;
    try {
      const frame = await decodeMessage(parse, buffer, receivedAt);
      const { bitmap, depths } = frame;
      if (mine !== generation) {
        bitmap?.close();
        return;
      }
      scope.postMessage({ ...frame, generation: mine }, bitmap ? [bitmap, depths.buffer] : [depths.buffer]);
    } catch (error) {
      bad(String(/** @type {Error} */ (error).message));
    }
  }, (buffer) => {
    try {
      const { header } = parse(buffer);
      scope.postMessage({ kind: 'dropped', sequence: Number(header.sequenceNumber ?? 0), bytes: buffer.byteLength });
      if (header.frameNumber) {
        send(JSON.stringify({ frameShown: { frameNumber: String(header.frameNumber) } }));
      }
    } catch (error) {
      bad(String(/** @type {Error} */ (error).message));
    }
  }, (buffer) => {
    try {
      const { header } = parse(buffer);
      return Boolean(header.tile || header.exactDeferred || header.error);
    } catch {
      return false;  // decoding says what is wrong
    }
  });
  const socket = makeSocket({
    open: () => scope.postMessage({ kind: 'open', generation }),
    closed: (code, reason) => scope.postMessage({ kind: 'closed', code, reason }),
    data: (buffer) => queue.push(buffer), bad,
    ended: () => {
      ++generation;
      queue.clear();
    },
  });
  /** @param {string} text */
  function send(text) {
    if (!socket.send(text)) {
      scope.postMessage({ kind: 'outgoing', text });
    }
  }

  scope.onmessage = ({ data }) => {
    switch (data.kind) {
      case 'open': socket.open(data.url, data.protocols); break;
      case 'send': send(data.text); break;
      case 'data': queue.push(data.buffer); break;
      case 'shown':
        if (data.generation === generation) {
          send(JSON.stringify({ frameShown: { frameNumber: String(data.frameNumber),
            decodeDuration: `${(data.decodeMs / 1000).toFixed(6)}s` } }));
        }
        break;
      case 'close': socket.close(); break;
    }
  };
}

/** The source of a worker: a module in one file has no address that a worker could import. */
export const workerSource = () =>
  `${[decodePicture, decodeMessage, makeQueue, makeSocket].join('\n')}\nconst parse = ${parseMessage};\n(${workerMain})(self, parse);`;

/**
 * Starts workerMain in a worker, or in the page if the page allows no worker.
 * @param {(message: any) => void} receive @returns {{post: (message: any, transfer?: any[]) => void,
 *   stop: () => void, isWorker: boolean}}
 */
export function startWorker(receive) {
  const inPage = () => {
    /** @type {{postMessage: (m: any) => void, onmessage: ((e: {data: any}) => void) | null}} */
    const scope = { postMessage: (message) => queueMicrotask(() => receive(message)), onmessage: null };
    workerMain(scope, parseMessage);
    return scope;
  };
  /** @type {ReturnType<typeof inPage> | null} */
  let page = null;
  /** @type {Worker | null} */
  let worker = null;
  /** @type {any[]} */
  const unanswered = [];
  try {
    const url = URL.createObjectURL(new Blob([workerSource()], { type: 'text/javascript' }));
    worker = new Worker(url);
    worker.onmessage = (event) => {
      unanswered.length = 0;
      receive(event.data);
    };
    // A content security policy reports only here.
    worker.onerror = () => {
      if (!page && unanswered.length > 0) {
        page = inPage();
        worker?.terminate();
        for (const message of unanswered.splice(0)) {
          page.onmessage?.({ data: message });
        }
      }
    };
  } catch {
    page = inPage();
  }
  return {
    get isWorker() { return page === null; },
    post(message, transfer = []) {
      if (page) {
        page.onmessage?.({ data: message });
      } else {
        if (message.kind === 'open') {
          unanswered.push(message);
        }
        worker?.postMessage(message, transfer);
      }
    },
    stop() {
      page?.onmessage?.({ data: { kind: 'close' } });
      worker?.terminate();
    },
  };
}
