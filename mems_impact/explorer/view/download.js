const file = JSON.parse(cb_obj.text)
const bytes = Uint8Array.from(atob(file.content), (letter) => letter.charCodeAt(0))

function save() {
  const link = document.createElement("a")
  link.href = URL.createObjectURL(new Blob([bytes]))
  link.download = file.name
  link.click()
  setTimeout(() => URL.revokeObjectURL(link.href), 1000)
}

// A browser may refuse to copy; the user gets a file then.
if (file.copied) navigator.clipboard.writeText(new TextDecoder().decode(bytes)).catch(save)
else save()
