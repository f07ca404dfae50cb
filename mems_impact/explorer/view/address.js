// A browser takes only so many changes of the address in a second.
clearTimeout(window.waiting_address)
const query = cb_obj.text
window.waiting_address = setTimeout(() => history.replaceState(null, "", "?" + query), 150)
