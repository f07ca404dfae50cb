// A browser takes only so many changes of the address in a second.
clearTimeout(window.waiting_address)
if (address.text !== "") {
  window.waiting_address = setTimeout(() => history.replaceState(null, "", "?" + address.text), 150)
}
