// The door: it asks for the token of the gateway, alone on the page, and shows what lies behind once it is right.
// @ts-check

import { byId } from './elements.js';
import { announcer } from './messages.js';
import { client, setToken, shown } from './page-view.js';
import { tokenOfText } from './view-state.js';

const door = byId('door', HTMLFormElement);
const field = byId('door-token', HTMLInputElement);
const sentence = byId('door-sentence', HTMLElement);
const button = byId('door-open', HTMLButtonElement);

const ASKED = 'This page needs its token: paste it, or the whole address that was printed when the server started.';
const WRONG = 'This is not the token, or no longer: paste that of the last start, or the whole address printed then.';

export const isDoorClosed = () => !door.hidden;

/** @param {boolean} isClosed whether nothing but the door can be reached */
function hideRest(isClosed) {
  door.hidden = !isClosed;
  for (const part of document.querySelectorAll('body > header, body > main, body > aside')) {
    part.toggleAttribute('inert', isClosed);
  }
}

/** @param {string} text */
function tell(text) {
  if (sentence.textContent !== text) {
    sentence.textContent = text;
    announcer.say(text);
  }
}

/** Asks for a token. */
export function closeDoor() {
  if (!isDoorClosed()) {
    hideRest(true);
    sentence.classList.remove('error');
    tell(client.token ? WRONG : ASKED);
    field.focus();
  }
}

async function tryToken() {
  const token = tokenOfText(field.value);
  if (!token) {
    field.focus();
    return;
  }
  button.disabled = true;
  const before = client.token;
  client.token = token;
  try {
    await client.requestOnce('v1/capabilities');
  } catch (error) {
    const { status, code, message } = /** @type {Error & {status: number, code: string}} */ (error);
    // A gateway whose coordinator is away or old has let the token pass.
    if (status === 401 || status === 0 || code === 'UNKNOWN') {
      client.token = before;
      button.disabled = false;
      sentence.classList.add('error');
      tell(status === 401 ? WRONG : message);
      field.select();
      return;
    }
  }
  button.disabled = false;
  field.value = '';
  hideRest(false);
  setToken(token);
  shown.root.focus({ preventScroll: true });
}

/** @param {() => void} opened called when the token is right */
export function listenToDoor(opened) {
  door.onsubmit = async (event) => {
    event.preventDefault();
    await tryToken();
    if (!isDoorClosed()) {
      opened();
    }
  };
  shown.addEventListener('status', (event) => {
    if (/** @type {CustomEvent} */ (event).detail.kind === 'refused') {
      event.preventDefault();
      closeDoor();
    }
  });
}
