// The menu of the bar's rarer buttons, where the window has no room for all of them (page.css says where).
// @ts-check

import { byId } from './elements.js';

const menu = byId('more', HTMLElement);
const opener = byId('more-open', HTMLButtonElement);

/** @param {boolean} isOpen */
function showMenu(isOpen) {
  menu.classList.toggle('open', isOpen);
  opener.setAttribute('aria-expanded', String(isOpen));
}

export function listenToMore() {
  opener.onclick = () => showMenu(!menu.classList.contains('open'));
  document.addEventListener('pointerdown', (event) => {
    if (!(/** @type {Element} */ (event.target).closest('#more, #more-open'))) {
      showMenu(false);
    }
  });
  document.addEventListener('keydown', (event) => {
    if (event.key === 'Escape' && menu.classList.contains('open')) {
      showMenu(false);
      opener.focus();
    }
  });
  // Undo and redo are pressed several times.
  menu.addEventListener('click', (event) => {
    if (!(/** @type {Element} */ (event.target).closest('.pair'))) {
      showMenu(false);
    }
  });
}
